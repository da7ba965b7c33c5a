"""Sizes as texts."""

from bus_bag.sizes import size_text
from rows import for_each


@for_each(
    ("size", "text"),
    [(0, "0 B"), (1023, "1023 B"), (1024, "1.0 KiB"), (134113280, "127.9 MiB"), (2**60, "1048576.0 TiB")],
)
def test_sizes(size: int, text: str) -> None:
    assert size_text(size) == text

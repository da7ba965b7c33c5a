"""Numbers as `bus top` writes them."""

from bus_cli.top.figures import bytes_text, count_text, rate_text, seconds_text, spark_text
from rows import for_each


@for_each(
    ("history", "text"),
    [
        ((), "          "),
        ((0.0, 0.0), "        ▁▁"),
        ((5.0,) * 3, "       ▆▆▆"),
        ((0.0, 1.0, 1000.0), "       ▁▂▆"),
        ((10.0,) * 60, "▆" * 10),
    ],
)
def test_a_steady_rate_is_no_full_block_and_little_is_more_than_nothing(
    history: tuple[float, ...], text: str
) -> None:
    assert spark_text(history) == text


@for_each(
    ("rate", "text"),
    [
        (None, "-"),
        (0.0, "0"),
        (0.5, "0.50"),
        (9.994, "9.99"),
        (29.94, "29.9"),
        (100.0, "100"),
        (12345.6, "12346"),
        (1e9, "1.00G"),
    ],
)
def test_rates(rate: float | None, text: str) -> None:
    assert rate_text(rate) == text


@for_each(
    ("count", "text"),
    [(0, "0"), (999_999, "999999"), (1_500_000, "1.50M"), (123_456_789, "123.46M"), (5 * 10**12, "5.00T")],
)
def test_counts(count: int, text: str) -> None:
    assert count_text(count) == text
    assert len(text) <= 7


@for_each(
    ("seconds", "text"),
    [
        (0.0, "0.0 µs"),
        (6.5e-5, "65.0 µs"),
        (0.0012, "1.2 ms"),
        (0.25, "250 ms"),
        (3.0, "3.0 s"),
        (4e3, "4000 s"),
    ],
)
def test_times(seconds: float, text: str) -> None:
    assert seconds_text(seconds) == text


def test_bytes() -> None:
    assert (bytes_text(None), bytes_text(999.0), bytes_text(2e6)) == ("-", "999 B", "2.00 MB")

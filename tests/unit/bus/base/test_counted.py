from bus.base.counted import counted
from rows import for_each


@for_each(
    ("number", "verb", "text"),
    [
        (0, (), "0 messages"),
        (1, (), "1 message"),
        (2, (), "2 messages"),
        (1, ("was", "were"), "1 message was"),
        (0, ("was", "were"), "0 messages were"),
    ],
)
def test_number_and_noun_agree(number: int, verb: tuple[str, ...], text: str) -> None:
    assert counted(number, "message", *verb) == text

"""Numbers with nouns in messages to people: "1 message", "2 messages"."""

__all__ = ["counted"]


def counted(number: int, noun: str, one: str = "", more: str = "") -> str:
    """The number, its noun (plural with "s"), and a verb if one is given: `one` after 1, else `more`."""
    return f"{number} {noun}{one and f' {one}'}" if number == 1 else f"{number} {noun}s{more and f' {more}'}"

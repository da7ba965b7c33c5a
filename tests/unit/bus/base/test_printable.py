"""bus.base.printable: characters of foreign texts that busd never prints to a terminal."""

import json
import sys
import unicodedata
from functools import cache

from bus.base.printable import printable, printable_json
from bus.errors import BusError, ConfigurationError, ServiceError, SharedMemoryError
from rows import for_each

HARMLESS = "plain äöü 漢字 \u00a0 שלום ❤\ufe0f 👩\u200d🚀 \\x1b % {}"


@cache
def hostile() -> str:
    """All of these characters. The search takes a second, so it is done once, and only for the tests that
    need it.
    """
    return "".join(
        letter
        for letter in map(chr, range(sys.maxunicode + 1))
        if unicodedata.category(letter) in ("Cc", "Zl", "Zp", "Cs")
        or unicodedata.bidirectional(letter)
        in ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
        or letter in "\u061c\u200e\u200f"
    )


@for_each("keep", ["", "\n", "\n\t"])
def test_no_hostile_character_is_left(keep: str) -> None:
    assert len(hostile()) == 65 + 2 + 2048 + 9 + 3
    left = set(printable(f"a{hostile()}b", keep)) & set(hostile())
    assert left == set(keep)


@for_each(
    ("text", "shown"),
    [
        ("\x1b]0;title\x07\x1b[31mred", r"\x1b]0;title\x07\x1b[31mred"),
        ("\x9b2J", r"\x9b2J"),
        ("a\r\nb\tc\x00", "a\\r\nb\tc\\x00"),
        ("user\u202egnp.exe", r"user\u202egnp.exe"),
        ("one\u2028two", r"one\u2028two"),
        ("\udc80", r"\udc80"),
    ],
)
def test_what_stands_in_their_place(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_a_text_on_one_line() -> None:
    assert printable("a\nb\tc", keep="") == r"a\nb\tc"


@for_each("text", ["", HARMLESS, f"{HARMLESS}\n\t"])
def test_the_rest_stays_as_it_is(text: str) -> None:
    assert printable(text) == text


def test_json_says_the_same() -> None:
    value = {hostile()[:-2048]: [HARMLESS, hostile().encode("utf-8", "ignore").decode()]}
    text = printable_json(json.dumps(value, ensure_ascii=False))
    assert not set(text) & set(hostile())
    assert json.loads(text) == value


@for_each(
    "error",
    [
        BusError("\x1b[2J"),
        ConfigurationError("\x1b[2J"),
        SharedMemoryError("\x1b[2J"),
        ServiceError("/s", "\x1b[2J"),
    ],
)
def test_no_error_s_text_reaches_a_terminal_as_it_is(error: BusError) -> None:
    assert r"\x1b[2J" in str(error)
    assert "\x1b" not in str(error)


def test_an_error_still_has_what_the_other_side_said() -> None:
    assert ServiceError("/s", "\x1b[2J").text == "\x1b[2J"

"""Texts for terminals that can show ASCII only."""

from collections.abc import Mapping

from bus_cli.top.ascii_text import ascii_text, is_ascii_only, is_dumb
from bus_plot.bars import bars_text
from rows import for_each


@for_each(
    ("environ", "expected"),
    [
        ({}, False),
        ({"LANG": "C.UTF-8"}, False),
        ({"LANG": "de_DE.utf8", "TERM": "xterm"}, False),
        ({"LC_ALL": "", "LANG": "de_DE.UTF-8"}, False),
        ({"LC_ALL": "C", "LANG": "C.UTF-8"}, True),
        ({"LC_CTYPE": "POSIX", "LANG": "C.UTF-8"}, True),
        ({"LANG": "de_DE.ISO-8859-1"}, True),
        ({"LC_ALL": "C.UTF-8", "TERM": "dumb"}, True),
    ],
)
def test_who_gets_ascii_only(environ: Mapping[str, str], expected: bool) -> None:
    assert is_ascii_only(environ) == expected
    assert is_dumb(environ) == ("TERM" in environ and environ["TERM"] == "dumb")


def test_columns_stay_where_they_are() -> None:
    text = f"/a  12.0 µs  {bars_text([0, 1, 2, 3, 4, 5, 6, 7])} repl…  \u00e9\u4e2d"
    assert ascii_text(text) == "/a  12.0 us  _.-:=+*# repl~  ??"
    assert ascii_text("╭─╮│") == "+-+|"
    assert ascii_text("\x1b[2J/topic") == "\x1b[2J/topic"

"""busd.logs: what a line looks like, and how many there may be."""

import json
import logging
from collections.abc import Callable, Iterator

import pytest

from busd.logs import _MOST_LINES, LOG_FORMATS, _Bounds, set_up

NASTY = 'a\n\x1b[2J"\udc80' + "x" * 5000


def record(level: int, text: str = "text", at_s: float = 7.0) -> logging.LogRecord:
    made = logging.LogRecord("busd", level, __file__, 1, text, (), None)
    made.created = at_s
    return made


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[[], str]]:
    """What was logged since the last call; afterwards the log is as it was."""
    root = logging.getLogger()
    before = root.level, root.handlers[:]
    yield lambda: capsys.readouterr().err
    root.level, root.handlers[:] = before


class TestBounds:
    def test_only_so_many_lines_in_a_second(self) -> None:
        bounds = _Bounds()
        kept = [bounds.filter(record(logging.WARNING)) for _ in range(_MOST_LINES + 5)]
        assert kept == [True] * _MOST_LINES + [False] * 5
        later = record(logging.INFO, at_s=8.0)
        assert bounds.filter(later)
        assert later.__dict__["left_out"] == 5

    def test_debug_lines_take_nobody_s_place(self) -> None:
        bounds = _Bounds()
        assert all(bounds.filter(record(logging.DEBUG)) for _ in range(2 * _MOST_LINES))
        assert bounds.filter(record(logging.WARNING))

    @pytest.mark.parametrize("level", [logging.ERROR, logging.CRITICAL])
    def test_errors_always_come_through(self, level: int) -> None:
        bounds = _Bounds()
        for _ in range(2 * _MOST_LINES):
            bounds.filter(record(logging.WARNING))
        assert bounds.filter(record(level))

    def test_lines_are_short_and_printable(self) -> None:
        long = record(logging.ERROR, NASTY)
        assert _Bounds().filter(long)
        assert long.getMessage() == 'a??[2J"?' + "x" * 992


class TestText:
    def test_a_line(self, said: Callable[[], str]) -> None:
        set_up("info", "text")
        logging.getLogger("busd").handle(record(logging.WARNING, "beware"))
        assert said() == "[WARN] [7.000000000] [busd]: beware\n"

    def test_says_how_many_were_left_out(self, said: Callable[[], str]) -> None:
        set_up("info", "text")
        for at_s in [7.0] * (_MOST_LINES + 3) + [8.0]:
            logging.getLogger("busd").handle(record(logging.INFO, at_s=at_s))
        assert said().splitlines()[-1].endswith("text (3 lines were left out)")


class TestJson:
    def test_a_line(self, said: Callable[[], str]) -> None:
        set_up("info", "json")
        made = record(logging.WARNING, "beware", at_s=1_700_000_000.25)
        made.__dict__.update(peer=4711, else_="not told")
        logging.getLogger("busd").handle(made)
        assert json.loads(said()) == {
            "time": "2023-11-14T22:13:20.250000+00:00",
            "severity": "WARN",
            "name": "busd",
            "message": "beware",
            "peer": 4711,
        }

    def test_says_how_many_were_left_out(self, said: Callable[[], str]) -> None:
        set_up("info", "json")
        for at_s in [7.0] * (_MOST_LINES + 3) + [8.0]:
            logging.getLogger("busd").handle(record(logging.INFO, at_s=at_s))
        assert json.loads(said().splitlines()[-1])["left_out"] == 3

    def test_one_line_whatever_stands_in_it(self, said: Callable[[], str]) -> None:
        set_up("info", "json")
        logging.getLogger("busd").error("%s", NASTY)
        (line,) = said().splitlines()
        assert line.isascii()
        assert json.loads(line)["message"].startswith('a??[2J"?x')

    def test_a_traceback_stays_in_its_line(self, said: Callable[[], str]) -> None:
        set_up("info", "json")
        try:
            raise ValueError(NASTY)
        except ValueError:
            logging.getLogger("asyncio").exception("bug")
        (line,) = said().splitlines()
        assert "ValueError: a\n\x1b[2J" in json.loads(line)["exception"]


@pytest.mark.parametrize("form", LOG_FORMATS)
def test_may_be_set_up_again(said: Callable[[], str], form: str) -> None:
    set_up("debug", "json" if form == "text" else "text")
    set_up("warn", form)
    logging.getLogger("busd").info("not said")
    logging.getLogger("busd").warning("said once")
    (line,) = said().splitlines()
    assert "said once" in line
    assert line.startswith("{" if form == "json" else "[")

"""busd.run: what the command line and the log take."""

import logging

import pytest

from busd.run import _MOST_LINES, _Bounds, main


def record(level: int, text: str = "text", at_s: float = 7.0) -> logging.LogRecord:
    made = logging.LogRecord("busd", level, __file__, 1, text, (), None)
    made.created = at_s
    return made


class TestLog:
    def test_only_so_many_lines_in_a_second(self) -> None:
        bounds = _Bounds()
        kept = [bounds.filter(record(logging.WARNING)) for _ in range(_MOST_LINES + 5)]
        assert kept == [True] * _MOST_LINES + [False] * 5
        later = record(logging.INFO, at_s=8.0)
        assert bounds.filter(later)
        assert later.getMessage() == "text (5 lines were left out)"

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
        long = record(logging.ERROR, "a\n\x1b[2J" + "x" * 5000)
        assert _Bounds().filter(long)
        assert long.getMessage() == "a??[2J" + "x" * 994


@pytest.mark.parametrize("text", ["abc", "", "0", "-1", "nan", "inf"])
def test_an_idle_exit_is_a_number_of_seconds(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([f"--idle-exit={text}"])
    told = capsys.readouterr().err.splitlines()[-1]
    assert told == f"busd: error: argument --idle-exit: {text!r} is not a number of seconds above 0"

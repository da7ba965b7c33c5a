"""busd.process.logs: the format of a line, the bound on queued lines, and no wait for a reader."""

import errno
import json
import logging
import os
import resource
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from busd.process import logs
from busd.process.logs import _MOST_LINES, _MOST_WAITING, LOG_FORMATS, _JsonLines, _Lines, _Text, set_up
from conftest import WAIT_S

NASTY = 'a\n\x1b[2J\u202e"\udc80' + "x" * 5000


def record(level: int, text: str = "text", at_s: float = 7.0) -> logging.LogRecord:
    made = logging.LogRecord("busd", level, __file__, 1, text, (), None)
    made.created = at_s
    return made


@pytest.fixture
def said(capfd: pytest.CaptureFixture[str]) -> Iterator[Callable[[], str]]:
    """The lines logged since the last call. Afterwards, the log is restored."""
    root = logging.getLogger()
    before = root.level, root.handlers[:]
    names = {level: logging.getLevelName(level) for level in (logging.WARNING, logging.CRITICAL)}
    root.handlers[:] = []

    def look() -> str:
        for handler in root.handlers:
            handler.flush()
        return capfd.readouterr().err

    yield look
    for handler in root.handlers:
        handler.close()
    root.level, root.handlers[:] = before
    for level, name in names.items():
        logging.addLevelName(level, name)  # another test of this process may expect Python's own names


class Reader:
    """Takes lines one by one while it is allowed to. Raises the error that the test sets."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.error: OSError | None = None
        self.may_go_on = threading.Event()
        self.may_go_on.set()
        self.is_in = threading.Event()

    def __call__(self, line: bytes) -> None:
        self.is_in.set()
        assert self.may_go_on.wait(WAIT_S)
        if self.error is not None:
            raise self.error
        assert line.endswith(b"\n")
        self.lines.append(line.decode()[:-1])


@pytest.fixture
def reader() -> Reader:
    return Reader()


@pytest.fixture
def lines(reader: Reader) -> Iterator[_Lines]:
    handler = _Lines(reader)
    yield handler
    reader.may_go_on.set()
    handler.close()


class TestBounds:
    def test_only_so_many_lines_in_a_second(self, lines: _Lines, reader: Reader) -> None:
        for number in range(_MOST_LINES + 5):
            lines.handle(record(logging.WARNING, str(number)))
        lines.handle(record(logging.INFO, "later", at_s=8.0))
        lines.flush()
        assert reader.lines == [*map(str, range(_MOST_LINES)), "(5 lines were left out)", "later"]

    def test_how_many_is_told_also_where_nothing_follows(
        self, lines: _Lines, reader: Reader, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        told = threading.Event()
        monkeypatch.setattr(logs, "_TELL_S", 0.01)
        monkeypatch.setattr(lines, "_write", lambda line: told.set() if line.startswith(b"(") else None)
        for _ in range(_MOST_LINES + 1):
            lines.handle(record(logging.WARNING))
        assert told.wait(WAIT_S)

    def test_it_is_told_at_the_end(self, lines: _Lines, reader: Reader) -> None:
        for _ in range(_MOST_LINES + 7):
            lines.handle(record(logging.WARNING))
        lines.flush()
        assert reader.lines[-1] == "(7 lines were left out)"

    def test_debug_lines_take_nobody_s_place(self, lines: _Lines, reader: Reader) -> None:
        for _ in range(2 * _MOST_LINES):
            lines.handle(record(logging.DEBUG, "debug"))
        lines.handle(record(logging.WARNING, "warning"))
        lines.flush()
        assert reader.lines == ["debug"] * 2 * _MOST_LINES + ["warning"]

    @pytest.mark.parametrize("level", [logging.ERROR, logging.CRITICAL])
    def test_errors_come_through_a_flood(self, lines: _Lines, reader: Reader, level: int) -> None:
        for _ in range(2 * _MOST_LINES):
            lines.handle(record(logging.WARNING))
        lines.handle(record(level, "error"))
        lines.flush()
        assert reader.lines[-1] == "error"


class TestReaders:
    """With any reader, or without one, a caller that logs does not wait."""

    def test_one_that_stands_still(self, lines: _Lines, reader: Reader) -> None:
        reader.may_go_on.clear()
        lines.handle(record(logging.ERROR, "first"))
        assert reader.is_in.wait(WAIT_S)
        for number in range(_MOST_WAITING + 30):
            lines.handle(record(logging.ERROR, str(number)))
        assert reader.lines == []
        reader.may_go_on.set()
        lines.flush()
        kept = [*map(str, range(_MOST_WAITING))]
        assert reader.lines[: _MOST_WAITING + 1] == ["first", *kept]
        lines.handle(record(logging.ERROR, "last"))
        lines.flush()
        assert reader.lines[_MOST_WAITING + 1 :] == ["(30 lines were left out)", "last"]

    def test_the_end_does_not_wait_for_it(
        self, lines: _Lines, reader: Reader, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(logs, "_FLUSH_S", 0.01)
        reader.may_go_on.clear()
        lines.handle(record(logging.ERROR))
        lines.flush()
        assert reader.lines == []

    def test_one_that_can_not_take_them(self, lines: _Lines, reader: Reader) -> None:
        """For example, the disk is full. The log does not retry lost lines; it reports them when there is
        room again.
        """
        reader.error = OSError(errno.ENOSPC, "full")
        for _ in range(3):
            lines.handle(record(logging.ERROR, "lost"))
            lines.flush()
        reader.error = None
        lines.handle(record(logging.ERROR, "there"))
        lines.flush()
        assert reader.lines == ["(3 lines were left out)", "there"]


class TestText:
    def test_a_line(self, said: Callable[[], str]) -> None:
        set_up("info", "text")
        logging.getLogger("busd").handle(record(logging.WARNING, "beware"))
        assert said() == "[WARN] [7.000000000] [busd]: beware\n"

    def test_lines_are_short_and_printable(self) -> None:
        assert _Text("%(message)s").format(record(logging.ERROR, NASTY)) == (
            r'a\n\x1b[2J\u202e"\udc80' + "x" * (1000 - 23)
        )

    def test_a_traceback_has_no_control_characters_either(self) -> None:
        made = record(logging.ERROR, "bug")
        made.exc_info = (ValueError, ValueError("a\n\x1b[2J"), None)
        assert _Text("%(message)s").format(made) == "bug\nValueError: a\n\\x1b[2J"

    def test_says_how_many_were_left_out(self, said: Callable[[], str]) -> None:
        set_up("info", "text")
        for at_s in [7.0] * (_MOST_LINES + 3) + [8.0]:
            logging.getLogger("busd").handle(record(logging.INFO, at_s=at_s))
        assert said().splitlines()[-2].endswith("] [busd]: (3 lines were left out)")


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
        told = json.loads(said().splitlines()[-2])
        assert (told["left_out"], told["severity"], told["name"]) == (3, "WARN", "busd")

    def test_one_line_whatever_stands_in_it(self) -> None:
        line = _JsonLines().format(record(logging.ERROR, NASTY))
        assert line.isascii() and "\n" not in line
        assert json.loads(line)["message"].startswith(r'a\n\x1b[2J\u202e"\udc80x')

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


def test_without_a_stderr_nobody_s_descriptor_2_is_written_to(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr", None)
    with pytest.raises(OSError, match="Bad file"):
        logs._Stderr(None).write(b"x")
    assert capfd.readouterr().err == ""


def test_after_a_line_that_there_was_no_room_for_the_next_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "stderr"
    fd = os.open(file, os.O_CREAT | os.O_RDWR)
    stderr = logs._Stderr(None)
    monkeypatch.setattr(stderr, "_fd", fd)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            stderr.write(b"too long for it\n")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    stderr.write(b"next\n")
    os.close(fd)
    assert file.read_text() == "too long f\nnext\n"


def test_a_descriptor_that_somebody_made_non_blocking(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread waits for it, as for any other descriptor."""
    ours, theirs = os.pipe()
    os.set_blocking(theirs, False)
    while True:
        try:
            os.write(theirs, bytes(4096))
        except BlockingIOError:
            break
    stderr = logs._Stderr(None)
    monkeypatch.setattr(stderr, "_fd", theirs)
    writing = threading.Thread(target=stderr.write, args=(b"x",))
    writing.start()
    got: Any = b""
    while not got.endswith(b"x"):
        got = os.read(ours, 1 << 20)
    writing.join(WAIT_S)
    assert not writing.is_alive()
    os.close(ours)
    os.close(theirs)

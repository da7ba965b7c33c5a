"""The output of a process, cut into lines."""

from logging import Logger
from typing import Any

from bus_launch.launch.actions.process_lines import ProcessLines


class _Kept(Logger):
    def __init__(self) -> None:
        super().__init__("kept")
        self.lines: list[str] = []

    def info(self, msg: object, *args: Any, **kwargs: Any) -> None:
        self.lines.append(str(msg))


def lines_of(*chunks: bytes, keep: bool = False) -> tuple[ProcessLines, list[str], list[str]]:
    out, err = _Kept(), _Kept()
    lines = ProcessLines((out, err), "[a-1] {}".format, keep=keep)
    for chunk in chunks:
        lines.feed("stdout", chunk)
    return lines, out.lines, err.lines


def test_a_line_waits_for_its_end() -> None:
    lines, out, err = lines_of(b"one\ntw", b"o\n\nthree")
    assert out == ["[a-1] one", "[a-1] two", "[a-1] "]
    lines.feed("stderr", b"else")
    lines.flush()
    assert out[3:] == ["[a-1] three"]
    assert err == ["[a-1] else"]
    lines.flush()
    assert len(out) == 4


def test_a_character_may_come_in_two_parts() -> None:
    text = "für".encode()
    _, out, _ = lines_of(text[:2], text[2:], b"\xff\n")
    assert out == ["[a-1] für\ufffd"]


def test_a_line_without_end_is_cut() -> None:
    lines, out, _ = lines_of(b"x" * (1 << 20), b"x" * 10)
    assert [len(line) for line in out] == [(1 << 20) + 6]
    lines.flush()
    assert out[1] == "[a-1] " + "x" * 10


def test_all_of_it_is_kept_where_that_is_asked_for() -> None:
    lines, _, _ = lines_of(b"one\ntw", b"o", keep=True)
    assert lines.text("stdout") == "one\ntwo"
    assert lines_of(b"one\n")[0].text("stdout") == ""

"""Waiting, standard input and arguments of tools."""

import io
from argparse import ArgumentTypeError
from types import SimpleNamespace

import pytest

from bus_ros.ros2cli import helpers
from rows import for_each


def test_waiting() -> None:
    answers = iter([False, False, True])
    assert helpers.wait_for(lambda: next(answers), -1.0, period=0.0) is True
    calls: list[int] = []
    assert helpers.wait_for(lambda: calls.append(1), 0.0, period=0.001) is None
    assert len(calls) >= 2, "the result is that of a call after the time"


def test_whole_numbers() -> None:
    assert helpers.unsigned_int("0") == 0


@for_each("text", ["-1", "x", "1.5"])
def test_no_whole_numbers(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="value must be non-negative integer"):
        helpers.unsigned_int(text)


def test_the_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    assert helpers.get_ros_domain_id() == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert helpers.get_ros_domain_id() == 7


def test_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(b"a\nb")))
    assert helpers.collect_stdin() == b"a\nb"

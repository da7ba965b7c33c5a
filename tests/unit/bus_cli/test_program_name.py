"""The name of the program in usage lines and errors."""

import sys

import pytest

from bus_cli.main import run
from bus_cli.program_name import program_name


@pytest.mark.parametrize(
    ("started", "name"),
    [("/env/bin/bus", "bus"), ("/env/bin/ros2", "ros2"), ("ros2", "ros2"), ("/x/bus_cli/__main__.py", "bus")],
)
def test_the_name_is_that_of_the_started_file(
    started: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [started, "topic", "list"])
    assert program_name() == name


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("tpoic list", "ros2: there is no command 'tpoic'; did you mean 'ros2 topic'?"),
        ("topic lsit", "ros2 topic: there is no verb 'lsit'; did you mean 'ros2 topic list'?"),
        ("topic info", "ros2 topic info: error: the following arguments are required: topic_name"),
        ("run", "ros2 run: error: the following arguments are required: script.py, or -m module, or PKG EXE"),
    ],
)
def test_errors_have_the_name(
    line: str, text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["/env/bin/ros2", *line.split()])
    with pytest.raises(SystemExit) as caught:
        run(line.split())
    assert caught.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1] == text

"""bus_cli.doctor.configuration: the file of a running daemon, checked by busd itself."""

from pathlib import Path

import pytest

from bus_cli import configuration
from bus_cli.doctor import procfs
from bus_cli.doctor.configuration import examine, file_of
from bus_cli.doctor.finding import Finding
from rows import for_each

HOME = Path("/home/x")


@for_each(
    ("line", "folder", "expected"),
    [
        ("busd --config /etc/busd.toml", HOME, "/etc/busd.toml"),
        ("python -m busd --socket=/x --config=/etc/busd.toml --log-level=debug", HOME, "/etc/busd.toml"),
        ("busd --config busd.toml", HOME, "/home/x/busd.toml"),
        ("busd --config busd.toml", None, None),
        ("busd --config", HOME, None),
        ("busd --config=", HOME, None),
        ("busd --idle-exit 30", HOME, None),
        ("", HOME, None),
    ],
)
def test_which_file(line: str, folder: Path | None, expected: str | None) -> None:
    assert file_of(line.split(), folder) == (None if expected is None else Path(expected))


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The configuration file of a running daemon."""
    file = tmp_path / "busd.toml"
    monkeypatch.setattr(procfs, "command_line", lambda pid: ["busd", "--config", str(file)])
    return file


def test_one_that_is_right(file: Path) -> None:
    file.write_text("[limits]\ntopics = 7\n")
    assert [*examine(file.parent / "0.sock", 1)] == [Finding("ok", "configuration", str(file))]


def test_one_that_was_broken_since(file: Path) -> None:
    file.write_text("[limits]\ntopicz = 7\n")
    (found,) = examine(file.parent / "0.sock", 1)
    assert found.mark == "fail"
    assert found.text == f"{file}: unknown key 'limits.topicz'; did you mean 'topics'?"


def test_rules_that_can_not_work(file: Path) -> None:
    """The rules allow other users something, and these users cannot reach the socket."""
    file.write_text('[[access]]\nusers = ["*"]\ntopics = "/x"\nactions = ["observe"]\n')
    path = file.with_name("0.sock")
    path.touch(mode=0o600)
    (found,) = examine(path, 1)
    assert found.mark == "warn"
    assert "[[access]] has rules for other users, but they can't reach" in found.text
    assert found.advice == f"edit {file}, then bus daemon reload"


def test_a_look_that_takes_too_long(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(configuration, "_CHECK_S", 0.0)
    (found,) = examine(file.parent / "0.sock", 1)
    assert (found.mark, found.text.partition(":")[0]) == ("warn", f"{file} could not be checked")


def test_a_daemon_without_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procfs, "command_line", lambda pid: ["busd"])
    assert [*examine(Path("/x"), 1)] == []

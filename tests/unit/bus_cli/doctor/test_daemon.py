"""bus_cli.doctor.daemon: findings about a daemon that answers, about one that does not, and about other
daemons.
"""

import os
import socket
import sys
import time
from pathlib import Path

import pytest

from bus.base.version import RELEASE
from bus.errors import BrokerUnavailable, RemoteProtocolError
from bus.wire import messages as m
from bus_cli.doctor import daemon as module
from bus_cli.doctor import procfs
from bus_cli.doctor.daemon import Seen, examine, others
from bus_cli.doctor.finding import Finding
from bus_cli.query import NotRunning
from metrics_views import PUBLISHER, endpoint, graph
from rows import for_each

PATH = Path("/run/busd/0.sock")


def seen(**fields: object) -> Seen:
    hello = m.Hello(**{"version": 1, "pid": 4711, "lease_s": 10.0, "release": RELEASE, **fields})  # type: ignore[arg-type]
    return Seen(hello, graph(endpoint(1, PUBLISHER)), None)


def look(subject: str, what: Seen | Exception, path: Path = PATH) -> Finding | None:
    found = [one for one in examine(path, what) if one.subject == subject]  # type: ignore[arg-type]
    return found[0] if found else None


@pytest.fixture(autouse=True)
def process(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """The fields of proc(5), the same for every process."""
    says: dict[str, object] = {
        "state": "S",
        "age_s": 3723.4,
        "executable": str(Path(sys.executable).resolve()),
        "open_files": (10, 1000),
    }
    for name in says:
        monkeypatch.setattr(procfs, name, lambda pid, name=name: says[name])
    return says


def test_one_that_answers() -> None:
    assert look("daemon", seen()) == Finding("ok", "daemon", "pid 4711, protocol 1, 1 node, up 1 h 2 min 3 s")
    assert look("release", seen()) == Finding("ok", "release", f"{RELEASE}, here and at the daemon")


def test_one_in_another_namespace(process: dict[str, object]) -> None:
    process.update(state="", age_s=None, executable=None, open_files=None)
    assert look("daemon", seen()) == Finding("ok", "daemon", "pid 4711, protocol 1, 1 node")
    assert look("daemon's files", seen()) is None


@pytest.mark.parametrize(("release", "shown"), [("0.0.9", "0.0.9"), ("", "an older one, without a number")])
def test_another_release(release: str, shown: str) -> None:
    text = f"{RELEASE} here, the daemon's is {shown}"
    assert look("release", seen(release=release)) == Finding("warn", "release", text, "bus daemon restart")


def test_files_that_changed_since_it_began(
    process: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "busd"
    package.mkdir()
    monkeypatch.setattr(module, "find_spec", lambda name: type("Spec", (), {"origin": str(package / "x.py")}))
    for number, age_s in enumerate((10_000, 5_000)):
        file = package / f"m{number}.py"
        file.touch()
        os.utime(file, (time.time() - age_s,) * 2)
    assert look("daemon's files", seen()) is None
    os.utime(file, (time.time() - 100,) * 2)
    found = look("daemon's files", seen())
    assert found == Finding(
        "warn", "daemon's files", f"changed since the daemon started: {file}", "bus daemon restart"
    )
    restarted = seen(began_ns=time.monotonic_ns() - 60 * 10**9)
    assert look("daemon's files", restarted) is None
    daemon = look("daemon", restarted)
    assert daemon is not None
    assert ", up 0 h 1 min " in daemon.text
    process["executable"] = "/bin/sh"  # another Python, with another busd
    assert look("daemon's files", seen()) is None
    process["executable"] = "/venv/bin/python3 (deleted)"
    found = look("daemon's files", seen())
    assert found is not None
    assert "its Python has been replaced" in found.text


def test_many_open_files(process: dict[str, object]) -> None:
    assert look("daemon's open files", seen()) is None
    process["open_files"] = (801, 1000)
    found = look("daemon's open files", seen())
    assert found is not None
    assert (found.mark, found.text) == ("warn", "801 of 1000 in use")


def test_none_and_none_may_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUSD_AUTOSTART", raising=False)
    assert look("daemon", NotRunning("x")) == Finding(
        "warn", "daemon", "not running; the first program that opens a node starts one"
    )
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    text = "not running, and BUSD_AUTOSTART is off"
    assert look("daemon", NotRunning("x")) == Finding("warn", "daemon", text, f"busd --socket {PATH}")


def test_one_that_does_not_answer(process: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "0.sock"
    path.touch()
    silence = BrokerUnavailable("busd took the connection but does not answer")
    advice = "bus daemon stop, or kill it; see its log"
    assert look("daemon", silence, path) == Finding("fail", "daemon", str(silence), advice)
    path.with_name("0.sock.lock").write_text("4711\n")
    assert look("daemon", silence, path) == Finding("fail", "daemon", f"{silence} (pid 4711)", advice)
    process["state"] = "T"
    text = "pid 4711 is stopped (SIGSTOP, Ctrl-Z or a debugger)"
    assert look("daemon", silence, path) == Finding("fail", "daemon", text, "kill -CONT 4711")


def test_one_that_says_what_is_wrong(tmp_path: Path) -> None:
    refusal = RemoteProtocolError("connections: 1 of 1 in use; busd's limit can be raised in busd.toml")
    assert look("daemon", refusal) == Finding("fail", "daemon", str(refusal))
    missing = BrokerUnavailable("cannot connect to busd: Permission denied")
    assert look("daemon", missing, tmp_path / "not ours") == Finding("fail", "daemon", str(missing))


@for_each(
    ("line", "expected"),
    [
        (["/usr/bin/python3", "-m", "busd", "--socket", "/x"], True),
        (["/venv/bin/python", "/venv/bin/busd"], True),
        (["busd"], True),
        (["python", "-X", "dev", "-m", "busd"], True),
        (["python", "-m", "bus_cli", "daemon"], False),
        (["grep", "-m", "1", "x"], False),
        ([], False),
    ],
)
def test_what_a_busd_looks_like(line: list[str], expected: bool) -> None:
    assert module._is_busd(line) is expected


def test_other_daemons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there, gone = tmp_path / "0.sock", tmp_path / "1.sock", tmp_path / "2.sock"
    for path in (here, there):
        path.touch()
    served = {1: [str(here)], 2: [str(there)], 3: [str(gone)], 4: []}
    monkeypatch.setattr(procfs, "pids_of", lambda uid: iter([4, 3, 2, 1, 5]))
    monkeypatch.setattr(procfs, "command_line", lambda pid: ["vi"] if pid == 5 else ["busd"])
    monkeypatch.setattr(procfs, "listens_on", lambda pid, sockets: served[pid])
    lost, other = others(here)
    assert lost == Finding(
        "warn",
        "other daemons",
        f"busd (pid 3) listens on {gone}, which is gone, so no program can find it",
        "kill 3",
    )
    assert other.text == f"pid 2 on {there}; their nodes and ours don't see each other"
    del served[2], served[3]
    monkeypatch.setattr(procfs, "pids_of", lambda uid: iter([1, 4]))
    assert [*others(here)] == []


def test_many_other_daemons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procfs, "pids_of", lambda uid: iter(range(1, 9)))
    monkeypatch.setattr(procfs, "command_line", lambda pid: ["busd"])
    monkeypatch.setattr(procfs, "listens_on", lambda pid, sockets: [str(tmp_path)])
    (found,) = others(tmp_path / "0.sock")
    assert found.text.count("pid ") == 5
    assert "and 3 more" in found.text


def test_a_real_listener_is_no_busd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procfs, "pids_of", lambda uid: iter([os.getpid()]))
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "x"))
        listening.listen(1)
        assert [*others(tmp_path / "0.sock")] == []

"""`bus doctor`: the socket, versions and the machine; and the output of findings."""

import errno
import os
import re
import resource
import socket
import sys
import time
from argparse import Namespace
from pathlib import Path

import msgspec
import pytest

from bus import shm
from bus.process.logfile import open_log
from bus.shm.headroom import Room
from bus_cli import doctor
from bus_cli.doctor import examine, machine, place, procfs, versions
from bus_cli.doctor.finding import Finding

OPTIONS: dict[str, object] = {
    "socket": None,
    "domain": None,
    "json": False,
    "report": False,
    "report_failed": False,
    "exclude_packages": False,
    "include_warnings": False,
    "live": False,
    "conformance": False,
    "story": None,
}


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "0.sock"
    monkeypatch.setenv("BUSD_SOCKET", str(path))
    monkeypatch.delenv("BUSD_AUTOSTART", raising=False)
    return path


def look(subject: str, **options: object) -> Finding:
    args = Namespace(**{**OPTIONS, **options})
    (found,) = (finding for finding in examine(args) if finding.subject == subject)
    return found


def test_the_socket_and_how_it_was_chosen(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert look("socket") == Finding("ok", "socket", f"{path} (from $BUSD_SOCKET)")
    assert look("socket", socket="/x/y").text == "/x/y (from --socket)"
    monkeypatch.delenv("BUSD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(path.parent))
    assert look("socket", domain=3).text == f"{path.parent}/busd/3.sock (from $XDG_RUNTIME_DIR, domain 3)"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert look("socket").text == f"/tmp/busd-{os.getuid()}/0.sock (from the default folder, domain 0)"


def test_a_path_that_can_be_no_socket(path: Path) -> None:
    found = look("socket", socket="/x" * 100)
    assert found.mark == "fail"
    assert "107" in found.text


def test_a_folder_of_ours_is_fine(path: Path) -> None:
    assert look("folder").mark == "ok"


def test_a_folder_that_is_not_there(path: Path) -> None:
    missing = path.parent / "missing"
    assert look("folder", socket=str(missing / "0.sock")) == Finding(
        "fail", "folder", f"{missing} is not there", f"mkdir -m 700 {missing}"
    )


def test_the_default_folder_is_made_by_busd(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUSD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(path.parent))
    folder = path.parent / "busd"
    assert look("folder") == Finding("ok", "folder", f"{folder} is not there; busd makes it")
    folder.mkdir(mode=0o755)
    found = look("folder")
    assert (found.mark, found.advice) == ("fail", f"chmod 700 {folder}")
    folder.chmod(0o700)
    assert look("folder").mark == "ok"


def test_a_folder_where_anybody_can_replace_files(path: Path) -> None:
    path.parent.chmod(0o777)
    assert look("folder").advice == f"chmod o-w {path.parent}"
    path.parent.chmod(0o1777)
    assert look("folder").mark == "ok"


def test_a_file_in_the_place_of_the_folder(path: Path) -> None:
    path.touch()
    assert look("folder", socket=str(path / "0.sock")).mark == "fail"


def test_a_folder_of_another_user(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    us = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    if us != 0:
        assert "set BUSD_SOCKET" in look("folder").advice
    monkeypatch.setattr(os, "geteuid", lambda: us)
    assert look("folder").mark == "ok"


def test_no_daemon_is_no_fault(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert look("daemon").mark == "warn"
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    assert look("daemon").advice == f"busd --socket {path}"


def test_what_a_dead_daemon_left(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    assert look("stale file").mark == "warn"


def test_what_is_in_the_way(path: Path) -> None:
    path.touch()
    assert look("stale file") == Finding(
        "fail", "stale file", f"{path} is in the way: it is not a socket", f"rm {path}"
    )


def test_what_is_in_the_way_of_the_log(path: Path) -> None:
    assert [*place.log_file(path)] == []
    log = path.with_suffix(".log")
    os.close(open_log(log))
    assert [*place.log_file(path)] == []
    log.write_text("precious")
    found = look("log")
    assert (found.mark, found.advice) == ("warn", "move that away, then: bus daemon restart")
    assert found.text.startswith(f"'{log}' is not a log of busd's: ")


def test_the_log_of_another_user_s_daemon_is_no_matter_of_ours(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path.with_suffix(".log").write_text("theirs")
    path.touch()
    us = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    assert [*place.log_file(path)] == []


def test_a_lock_without_a_socket(path: Path) -> None:
    path.with_name("0.sock.lock").write_text("4711")
    assert look("stale file").text == f"{path}.lock was left by a dead daemon"


def test_sockets_of_other_domains_that_nobody_serves(path: Path) -> None:
    dead, live = path.with_name("7.sock"), path.with_name("8.sock")
    with socket.socket(socket.AF_UNIX) as left, socket.socket(socket.AF_UNIX) as listening:
        left.bind(str(dead))
        listening.bind(str(live))
        listening.listen(1)
        path.with_name("9.sock").touch()
        assert [*place.leftovers(path, is_default=False)] == []
        assert [*place.leftovers(path, is_default=True)] == [
            Finding("warn", "stale file", f"{dead} was left by a dead daemon", f"rm {dead}")
        ]


def test_who_may_connect(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        path.chmod(0o600)
        (found,) = place.socket_file(path)
        assert found == Finding(
            "ok", "permissions", f"belongs to uid {os.getuid()}, gid {path.stat().st_gid}, mode 0600"
        )
        path.chmod(0o666)
        (found,) = place.socket_file(path)
        assert found.text.endswith("mode 0666: every user may connect, and do what [[access]] allows")


def test_a_socket_that_is_not_for_us(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root has every permission
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        (found,) = place.socket_file(path)
    assert found.mark == "fail"
    assert f"uid {os.geteuid()} may not connect" in found.text
    assert "[socket] mode and group" in found.advice


def test_a_folder_of_the_user_whose_daemon_serves_us(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That user has checked the folder. For our own daemon, the folder would not be good enough."""
    us = os.geteuid()
    os.chown(path.parent, us, -1)
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    if us == 0:
        os.chown(path.parent, 4711, -1)
    assert place.folder(path.parent, is_default=False, is_served=False).mark == "fail"
    assert place.folder(path.parent, is_default=False, is_served=True).mark == "ok"
    assert place.folder(path.parent, is_default=True, is_served=True).mark == "fail"


def test_versions(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert look("msgspec").text == msgspec.__version__
    assert look("python").mark == "ok"
    monkeypatch.setattr(versions, "version", lambda _: None)
    assert look("uvloop") == Finding(
        "warn", "uvloop", "not there; asyncio's own loop is slower", "pip install uvloop"
    )


def test_shared_memory(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.setenv("BUS_NATIVE", "auto")
    if not shm.is_available():
        pytest.skip(shm.why_not())
    assert look("shared memory") == Finding("ok", "shared memory", "used between processes of one user")


@pytest.mark.parametrize(("name", "value"), [("BUS_ROUTE", "socket"), ("BUS_NATIVE", "no")])
def test_shared_memory_that_is_turned_off(
    path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    for variable in ("BUS_ROUTE", "BUS_NATIVE"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv(name, value)
    text = f"not used: {name}={value} is set; messages go through busd"
    assert look("shared memory") == Finding("warn", "shared memory", text, f"unset {name}")


def test_no_native_core(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.setenv("BUS_NATIVE", "auto")
    monkeypatch.setitem(sys.modules, "bus.shm._core", None)  # as if the module were missing
    found = look("shared memory")
    assert found.mark == "warn"
    assert found.text.startswith("not used: the native core was not built (")
    assert "BUS_NATIVE=yes" in found.advice


def test_a_core_that_is_older_than_its_sources(tmp_path: Path) -> None:
    assert [*versions.native_core(tmp_path)] == []
    # From 100 s on: the clock of files is some milliseconds behind time.time().
    for age, name in enumerate(("py_c.c", "py_b.c", "_core.abi3.so", "py_a.c", "py.h"), 1):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time.time() - 100 * age,) * 2)
    (found,) = versions.native_core(tmp_path)
    assert (found.mark, found.text) == ("warn", "built before py_b.c, py_c.c changed")
    (tmp_path / "_core.abi3.so").touch()
    assert [*versions.native_core(tmp_path)] == []


def test_a_machine_without_memory_to_share(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str, flags: int) -> int:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.setenv("BUS_NATIVE", "auto")
    if not shm.is_available():
        pytest.skip(shm.why_not())
    monkeypatch.setattr(os, "memfd_create", refuse)
    text = f"not used: the system refuses it ({os.strerror(errno.ENOSYS)}); messages go through busd"
    assert look("shared memory") == Finding("warn", "shared memory", text)


def test_few_descriptors(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (256, 4096))
    assert look("open files") == Finding("warn", "open files", "limit 256", "ulimit -n 4096")
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (256, 256))
    advice = "LimitNOFILE= in a systemd unit, or nofile in /etc/security/limits.conf"
    assert look("open files") == Finding("warn", "open files", "limit 256", advice)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (4096, 4096))
    assert look("open files").mark == "ok"


def test_a_machine_without_descriptors(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = {"/proc/sys/fs/file-nr": 81, "/proc/sys/fs/file-max": 100}
    monkeypatch.setattr(procfs, "number_in", lambda path, name="": numbers.get(path))
    found = [one for one in machine.limits() if "whole machine" in one.text]
    assert [one.text for one in found] == ["the whole machine has 81 of 100 in use"]
    numbers["/proc/sys/fs/file-nr"] = 80
    assert not [one for one in machine.limits() if "whole machine" in one.text]


HELD = {"queued_bytes_per_user": 512 << 20, "history_bytes_per_user": 256 << 20}


def of_machine(left_mib: int, limit_mib: int = 4096) -> Room:
    return Room("the machine", limit_mib << 20, left_mib << 20)


def of_cgroup(name: str, left_mib: int, limit_mib: int) -> Room:
    return Room(f"memory cgroup /{name}", limit_mib << 20, left_mib << 20)


@pytest.mark.parametrize(
    ("here", "limits", "mark", "text"),
    [
        ([of_machine(300)], {}, "ok", "300 of 4096 MiB of the machine are free"),
        ([of_machine(200)], {}, "warn", "200 of 4096 MiB of the machine are free"),
        ([of_machine(200, 512)], {}, "ok", "200 of 512 MiB of the machine are free"),
        ([of_machine(700)], HELD, "warn",
         "700 of 4096 MiB of the machine are free; busd may hold 768 MiB for one user"),
        ([of_machine(800)], HELD, "ok", "800 of 4096 MiB of the machine are free"),
        ([of_cgroup("a", 8, 30), of_machine(800)], {}, "warn", "8 of 30 MiB of memory cgroup /a are free"),
        ([of_cgroup("a", 80, 100), of_machine(800)], {}, "ok", "80 of 100 MiB of memory cgroup /a are free"),
        ([of_cgroup("a", 900, 1000), of_machine(800)], HELD, "ok", "800 of 4096 MiB of the machine are free"),
    ],
)  # fmt: skip
def test_memory(
    monkeypatch: pytest.MonkeyPatch, here: list[Room], limits: dict[str, int], mark: str, text: str
) -> None:
    for daemon in (None, 4711):
        monkeypatch.setattr(machine, "rooms", lambda process: iter(here))
        (found,) = machine.memory(limits, daemon)
        assert (found.mark, found.text) == (mark, text)


def test_memory_of_a_daemon_in_another_cgroup(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit of the daemon's memory counts, not ours."""
    of = {"self": of_cgroup("robot", 300, 400), 4711: of_cgroup("busd", 600, 2048)}
    monkeypatch.setattr(machine, "rooms", lambda process: iter([of[process], of_machine(4000, 8000)]))
    assert [(one.mark, one.subject, one.text) for one in machine.memory(HELD, 4711)] == [
        ("ok", "memory", "300 of 400 MiB of memory cgroup /robot are free"),
        ("warn", "memory",
         "the daemon: 600 of 2048 MiB of memory cgroup /busd are free; busd may hold 768 MiB for one user"),
    ]  # fmt: skip


def test_memory_of_which_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "rooms", lambda process: iter(()))
    assert [*machine.memory(HELD, 4711)] == []


def test_a_clock_that_is_set_while_we_look(monkeypatch: pytest.MonkeyPatch) -> None:
    real, ahead_s = time.time, 0.0
    monkeypatch.setattr(time, "time", lambda: real() + ahead_s)
    watch = machine.ClockWatch()
    assert watch.finding().mark == "ok"
    ahead_s = -3600.0
    found = watch.finding()
    assert found.mark == "warn"
    assert found.text.startswith("it was just set by -3600.0")


def test_a_clock_that_is_not_set(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert look("clock").mark == "ok"
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert look("clock").mark == "warn"


@pytest.mark.parametrize(("is_missing", "code"), [(False, 0), (True, 1)])
def test_it_fails_where_something_fails(
    path: Path, is_missing: bool, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    where = path.parent / "missing" / "0.sock" if is_missing else path
    assert doctor.main(Namespace(**{**OPTIONS, "socket": str(where)})) == code
    findings, _, end = capsys.readouterr().out.partition("\n\n")
    assert ("check(s) failed\n\nFailed modules: folder\n" in end) is is_missing
    assert (re.fullmatch(r"All \d+ checks passed\n\n", end) is None) is is_missing
    lines = findings.splitlines()
    assert all(line.startswith(("[ ok ] ", "[warn] ", "[fail] ", "       -> ")) for line in lines)
    assert any(line.startswith("[fail]") for line in lines) is is_missing


def test_json(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    doctor.main(Namespace(**{**OPTIONS, "json": True}))
    lines = [msgspec.json.decode(line, type=dict) for line in capsys.readouterr().out.splitlines()]
    assert {"mark", "subject", "text", "advice"} == set(lines[0])


def test_the_page_has_every_subject() -> None:
    root = Path(__file__).parents[4]
    sources = "".join(path.read_text() for path in Path(str(doctor.__file__)).parent.glob("*.py"))
    subjects = set(re.findall(r'\b(?:ok|warn|fail)\(\s*"([^"]+)"', sources))
    _, _, page = (root / "docs" / "operation.md").read_text().partition("\n## Doctor\n")
    rows = [line.split("|")[1] for line in page.partition("\n## ")[0].splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`([^`]+)`", row)} == subjects

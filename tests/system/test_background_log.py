"""The log of a busd in the background: other files at its path, its size, and reports about it."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bus.errors import BrokerUnavailable
from bus.link import autostart
from bus.process.logfile import MARK, MOST_BYTES, open_log
from cli import BUS, bus
from conftest import WAIT_S
from neighbours import wait_until
from raw_peer import RawPeer
from system.test_autostart import daemons
from unit.bus.process.test_logfile import KINDS, KINDS_OF_ROOT, lines, look, thing
from users import GUEST, needs_users

IDLE = ("--idle-exit", "60")
DAILY_KINDS = ("text", "folder", "fifo")
"""The unit tests of the log file have each kind daily."""
SLOW_BUSD = "import sys, time\nif 'busd' in sys.orig_argv:\n    time.sleep(600)\n"


@pytest.fixture(autouse=True)
def path(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A path without a server; at the end, kills the daemons started there."""
    monkeypatch.delenv("BUSD_AUTOSTART")
    monkeypatch.setattr(autostart, "_started", set())
    yield socket_path
    for pid in daemons(socket_path):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    for pid in autostart._started:
        with suppress(ChildProcessError):
            os.waitpid(pid, 0)


@pytest.fixture
def log(path: Path) -> Path:
    return path.with_suffix(".log")


def start(path: Path, *options: str) -> int:
    """Starts a busd in the background; its pid."""

    async def run() -> None:
        async with asyncio.timeout(WAIT_S):
            await autostart.start(path, [*IDLE, *options])

    asyncio.run(run())
    (pid,) = daemons(path)
    return pid


def stderr_of(pid: int) -> Path:
    return Path(f"/proc/{pid}/fd/2")


def make_it_talk(path: Path, number: int = 1) -> None:
    """Makes busd write log lines: it logs each connection at level debug."""
    for _ in range(number):
        with RawPeer(path) as peer:
            peer.hello()


class TestInTheWay:
    @pytest.mark.parametrize(
        "kind",
        [
            *DAILY_KINDS,
            *(pytest.param(kind, marks=pytest.mark.nightly) for kind in KINDS if kind not in DAILY_KINDS),
            *(pytest.param(*kind.values, marks=[*kind.marks, pytest.mark.nightly]) for kind in KINDS_OF_ROOT),
        ],
    )
    def test_it_stays_as_it_is_and_all_goes_on(
        self, kind: str, path: Path, log: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        with thing(kind, log):
            before = look(log)
            pid = start(path, "--log-level", "debug")
            make_it_talk(path)
            assert look(log) == before
        said = capfd.readouterr().err
        assert f"busd has no file for its log, which is in memory: '{log}' is not a log of busd's: " in said
        wait_until(lambda: "connected" in stderr_of(pid).read_text())

    @pytest.mark.parametrize("verb", ["node list", "daemon start"])
    def test_whoever_starts_it_is_told(self, verb: str, path: Path, log: Path) -> None:
        os.mkfifo(log)
        result = bus(*verb.split())
        assert result.code == 0
        assert f"'{log}' is not a log of busd's: it is no regular file" in result.err

    def test_the_reason_why_it_can_not_start_needs_no_file(self, path: Path, log: Path) -> None:
        path.write_text("precious")
        log.write_text("also precious")
        with pytest.raises(BrokerUnavailable, match="exists and is not a socket"):
            start(path)
        assert (path.read_text(), log.read_text()) == ("precious", "also precious")

    def test_a_restart_has_the_file_when_the_way_is_free(self, path: Path, log: Path) -> None:
        log.write_text("precious")
        assert bus("daemon", "start").code == 0
        log.unlink()
        assert bus("daemon", "restart").code == 0
        assert bus("daemon", "stop").code == 0
        assert "stopped: " in "".join(lines(log))

    def test_a_log_in_memory_is_bounded_too(self, path: Path, log: Path) -> None:
        log.mkdir()
        pid = start(path, "--log-level", "debug")
        with stderr_of(pid).open("ab") as file:
            file.write(b"x" * MOST_BYTES + b"\n")
        make_it_talk(path)
        wait_until(lambda: stderr_of(pid).stat().st_size < 4096)
        make_it_talk(path)
        wait_until(lambda: "connected" in stderr_of(pid).read_text())
        assert stderr_of(pid).read_bytes().startswith(MARK)


def is_small(log: Path) -> bool:
    try:
        return log.stat().st_size < MOST_BYTES
    except FileNotFoundError:  # busd is renaming it
        return False


class TestSize:
    def test_what_was_there_stays(self, path: Path, log: Path) -> None:
        start(path)
        assert bus("daemon", "stop").code == 0
        before = lines(log)
        start(path)
        assert bus("daemon", "stop").code == 0
        assert lines(log)[: len(before)] == before
        assert len(lines(log)) == 2 * len(before)

    def test_one_that_runs_turns_it_over(self, path: Path, log: Path) -> None:
        start(path, "--log-level", "debug")
        for text in ("first", "second"):
            fd = open_log(log)
            os.write(fd, f"{text}\n{'x' * MOST_BYTES}\n".encode())
            os.close(fd)
            make_it_talk(path)
            wait_until(lambda: is_small(log))
        assert "second" in lines(log.with_name(f"{log.name}.1"))
        make_it_talk(path)
        wait_until(lambda: log.exists() and "connected" in log.read_text())
        assert {one.name for one in path.parent.glob("*.log*")} == {log.name, f"{log.name}.1"}

    def test_starts_that_fail_do_not_fill_the_disk(self, path: Path, log: Path) -> None:
        path.mkdir()
        os.write(fd := open_log(log), b"x" * MOST_BYTES)
        os.close(fd)
        with pytest.raises(BrokerUnavailable, match="is not a socket"):
            start(path)
        assert log.stat().st_size < 4096

    def test_where_files_may_not_be_so_large(self, path: Path, log: Path) -> None:
        """The signal of the system for this limit does not end busd, and busd continues to log."""
        most = 16_384
        limited = ["prlimit", f"--fsize={most}", *BUS, "daemon", "start", "--debug"]
        assert subprocess.run(limited, timeout=WAIT_S, check=False).returncode == 0
        old = log.with_name(f"{log.name}.1")
        make_it_talk(
            path, 2 * most // len("[DEBUG] [1763769600.123456789] [busd]: lost pid 1: closed its connection")
        )
        wait_until(old.exists)
        make_it_talk(path)
        wait_until(lambda: log.exists() and "connected" in log.read_text())
        assert log.stat().st_size <= most and old.stat().st_size <= most


class TestFolders:
    @pytest.mark.parametrize("verb", ["node list", "daemon start", "daemon peers"])
    def test_a_missing_one_is_not_made(self, verb: str, tmp_path: Path) -> None:
        missing = tmp_path / "missing"
        result = bus(*verb.split(), "--socket", str(missing / "x" / "0.sock"))
        assert (result.code, result.out) == (1, "")
        assert not missing.exists()
        if verb != "daemon peers":  # which starts no daemon
            assert result.err == (
                f"no busd is started: no socket can be made in '{missing / 'x'}': No such file or directory; "
                "make the folder, or choose another path\n"
            )

    def test_nor_one_above_the_default_one(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        missing = tmp_path / "missing"
        monkeypatch.delenv("BUSD_SOCKET")
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(missing))
        result = bus("node", "list")
        reason = f"no socket can be made in '{missing / 'busd'}': No such file or directory; '{missing}'"
        assert (result.code, result.err) == (1, f"no busd is started: {reason} is not there\n")
        assert not missing.exists()

    @pytest.mark.parametrize("command", [(*BUS, "node", "list"), (sys.executable, "-m", "busd")])
    @needs_users
    def test_root_takes_no_user_s_folder_from_him(
        self, command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """As with `sudo --preserve-env`."""
        monkeypatch.delenv("BUSD_SOCKET")
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        os.chown(tmp_path, GUEST, GUEST)
        ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
        assert ended.returncode == 1
        assert f"the folder above belongs to uid {GUEST}" in ended.stderr
        assert not list(tmp_path.iterdir())

    @needs_users
    def test_root_leaves_nothing_in_a_user_s_folder(self, tmp_path: Path) -> None:
        folder = tmp_path / "user"
        folder.mkdir()
        os.chown(folder, GUEST, GUEST)
        result = bus("node", "list", "--socket", str(folder / "0.sock"))
        assert result.code == 1
        assert f"(owner uid {GUEST}, mode 0755): it belongs to another user than uid 0" in result.err
        assert not list(folder.iterdir())

    @needs_users
    def test_in_a_folder_for_all_the_log_of_somebody_else_is_left_alone(self, tmp_path: Path) -> None:
        folder = tmp_path / "tmp"
        folder.mkdir()
        folder.chmod(0o1777)
        tmp_path.chmod(0o755)
        (folder / "app.log").write_text("his")
        os.chown(folder / "app.log", GUEST, GUEST)
        result = bus("node", "list", "--socket", str(folder / "app.sock"))
        assert result.code == 0
        assert (folder / "app.log").read_text() == "his"
        assert f"it belongs to user {GUEST}" in result.err
        assert bus("daemon", "stop", "--socket", str(folder / "app.sock")).code == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_while_it_starts_a_program_hears_signals(
    number: int, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(SLOW_BUSD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    with subprocess.Popen([*BUS, "node", "list"], stderr=subprocess.PIPE) as program:
        wait_until(lambda: daemons(path))
        program.send_signal(number)
        assert program.communicate(timeout=WAIT_S)[1] == b""
        assert program.returncode == -number

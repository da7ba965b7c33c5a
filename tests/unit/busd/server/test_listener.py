"""busd.server.listener with real sockets, files and processes."""

import asyncio
import errno
import fcntl
import os
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from bus.errors import ConfigurationError
from busd.server.credentials import process_name
from busd.server.listener import BACKLOG, AlreadyRunning, open_listener

pytestmark = pytest.mark.both_loops

STRANGER = 12345
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to another user")

DAEMON = """
import os, sys
from pathlib import Path
from busd.server.listener import AlreadyRunning, open_listener
print("ready", flush=True)
sys.stdin.readline()
try:
    listener = open_listener(Path(sys.argv[1]), environ={})
except AlreadyRunning as error:
    print("refused", error.pid, flush=True)
else:
    print("won", os.getpid(), flush=True)
    sys.stdin.readline()
    listener.close()
"""

Process = subprocess.Popen[str]


def hear(process: Process) -> list[str]:
    assert process.stdout is not None
    return process.stdout.readline().split()


def wave(process: Process) -> None:
    """Let a process continue that waits for a line."""
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


@pytest.fixture
def daemon(path: Path) -> Iterator[Callable[[], Process]]:
    """Starts processes that wait before they open `path`. None of them outlives the test."""
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with ExitStack() as running:

        def start() -> Process:
            command, pipe = [sys.executable, "-c", DAEMON, str(path)], subprocess.PIPE
            started = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environ)
            process = running.enter_context(started)
            running.callback(process.kill)
            assert hear(process) == ["ready"]
            return process

        yield start


@pytest.fixture
def serving(daemon: Callable[[], Process]) -> Process:
    process = daemon()
    wave(process)
    assert hear(process) == ["won", str(process.pid)]
    return process


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "0.sock"


@pytest.fixture
def lock(path: Path) -> Path:
    return path.with_name("0.sock.lock")


@pytest.fixture
def environ(tmp_path: Path) -> dict[str, str]:
    """Makes tmp_path/busd the default folder."""
    return {"XDG_RUNTIME_DIR": str(tmp_path)}


def answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        return client.connect_ex(str(path)) == 0


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


def refusal(path: Path | None, environ: dict[str, str] | None = None) -> str:
    with pytest.raises(ConfigurationError) as caught:
        open_listener(path, environ=environ or {})
    return str(caught.value)


def test_a_listener_listens_and_leaves_nothing(path: Path, lock: Path) -> None:
    with open_listener(path, environ={}) as listener:
        assert (listener.path, listener.activated) == (path, False)
        assert not listener.socket.getblocking()
        assert answers(path)
        assert mode(path) == mode(lock) == 0o600
        assert lock.read_text() == f"{os.getpid()}\n"
    assert not list(path.parent.iterdir())
    listener.close()


def test_many_may_wait_to_be_accepted(path: Path) -> None:
    with open_listener(path, environ={}), ExitStack() as clients:
        for _ in range(128):
            client = clients.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            client.setblocking(False)
            client.connect(str(path))


async def test_asyncio_may_close_the_socket_first(path: Path) -> None:
    listener = open_listener(path, environ={})
    loop = asyncio.get_running_loop()
    server = await loop.create_unix_server(asyncio.Protocol, sock=listener.socket, backlog=BACKLOG)
    assert answers(path)
    server.close()
    listener.close()
    assert not list(path.parent.iterdir())


def test_on_a_full_disk_the_lock_is_held_without_a_pid(
    path: Path, lock: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pwrite(fd: int, content: bytes, offset: int) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", pwrite)
    with open_listener(path, environ={}):
        assert lock.read_text() == ""
        with pytest.raises(AlreadyRunning) as caught:
            open_listener(path, environ={})
        assert caught.value.pid is None
    assert list(path.parent.iterdir()) == []


def test_files_that_are_not_ours_any_more_stay(path: Path, lock: Path) -> None:
    listener = open_listener(path, environ={})
    path.unlink()
    lock.unlink()
    lock.touch()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(path))
        listener.close()
        assert sorted(path.parent.iterdir()) == [path, lock]


def test_of_ten_that_race_one_wins(daemon: Callable[[], Process], path: Path) -> None:
    racers = [daemon() for _ in range(10)]
    for racer in racers:
        wave(racer)
    said = [hear(racer) for racer in racers]
    (winner,) = [racer for racer, (word, _) in zip(racers, said, strict=True) if word == "won"]
    assert {pid for word, pid in said if word == "refused"} <= {str(winner.pid), "None"}
    assert answers(path)
    wave(winner)
    assert winner.wait() == 0
    assert not list(path.parent.iterdir())


def test_never_two_at_once_while_others_come_and_go(path: Path) -> None:
    inside = threading.Lock()
    alone: list[bool] = []

    def come_and_go() -> None:
        for _ in range(150):
            with suppress(AlreadyRunning), open_listener(path, environ={}):
                alone.append(inside.acquire(blocking=False) and answers(path))
                inside.release()

    with ThreadPoolExecutor(6) as pool:
        for ended in [pool.submit(come_and_go) for _ in range(6)]:
            ended.result()
    assert alone
    assert all(alone)
    assert not list(path.parent.iterdir())


def test_a_lock_file_removed_by_its_last_holder_does_not_count(
    path: Path, lock: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = []
    real = fcntl.flock

    def flock(fd: int, operation: int) -> None:
        real(fd, operation)
        locked.append(os.fstat(fd).st_ino)
        if len(locked) == 1:
            lock.unlink()

    monkeypatch.setattr(fcntl, "flock", flock)
    with open_listener(path, environ={}):
        assert len(locked) == 2
        assert lock.stat().st_ino == locked[1]
    monkeypatch.setattr(fcntl, "flock", lambda *_: lock.unlink())
    assert refusal(path) == f"can't lock '{lock}': it is replaced again and again"


def test_a_live_daemon_is_not_replaced(serving: Process, path: Path) -> None:
    with pytest.raises(AlreadyRunning) as caught:
        open_listener(path, environ={})
    assert caught.value.pid == serving.pid
    assert str(caught.value) == f"busd is already running on {path} (pid {serving.pid})"
    assert answers(path)


def test_a_killed_daemon_is_replaced(serving: Process, path: Path, lock: Path) -> None:
    serving.kill()
    serving.wait()
    lock.write_text("9" * 30)
    assert path.is_socket()
    assert not answers(path)
    with open_listener(path, environ={}):
        assert answers(path)
        assert lock.read_text() == f"{os.getpid()}\n"
    assert not list(path.parent.iterdir())


@pytest.mark.parametrize("text", ["", "no number", "-1", "0", "9" * 30, str(2**22 + 1)])
def test_a_lock_that_names_no_process(path: Path, lock: Path, text: str) -> None:
    lock.write_text(text)
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert refusal(path) == f"busd is already running on {path}"


def test_a_socket_that_answers_is_not_stale_though_its_lock_is_gone(path: Path, lock: Path) -> None:
    us = os.getpid()
    with open_listener(path, environ={}):
        lock.unlink()
        assert refusal(path) == f"{process_name(us)} is already running on {path} (pid {us})"
        assert answers(path)
    assert not list(path.parent.iterdir())


def test_a_socket_with_a_full_backlog_is_not_stale(path: Path) -> None:
    kind = (socket.AF_UNIX, socket.SOCK_STREAM)
    with socket.socket(*kind) as busy, socket.socket(*kind) as client:
        busy.bind(str(path))
        busy.listen(0)
        client.connect(str(path))
        assert refusal(path) == f"busd is already running on {path}"
        assert path.is_socket()


def test_a_socket_of_another_kind_is_not_replaced(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.bind(str(path))
        assert refusal(path).startswith(f"can't listen on '{path}': ")
        assert list(path.parent.iterdir()) == [path]


def test_what_is_not_a_socket_is_not_replaced(path: Path) -> None:
    path.write_text("precious")
    assert refusal(path) == f"'{path}' exists and is not a socket; busd does not replace it"
    assert path.read_text() == "precious"
    assert list(path.parent.iterdir()) == [path]


def test_a_link_to_a_stale_socket_is_not_followed(path: Path) -> None:
    target = path.with_name("target")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(target))
    path.symlink_to(target)
    assert "exists and is not a socket" in refusal(path)
    assert target.is_socket()


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda lock, other: lock.symlink_to(other), "it is a symbolic link"),
        (lambda lock, other: lock.hardlink_to(other), ", 2 links)"),
        (lambda lock, other: os.mkfifo(lock), "mode prw"),
        (lambda lock, other: lock.mkdir(), "Is a directory"),
        pytest.param(
            lambda lock, other: os.chown(other.rename(lock), STRANGER, 0), f"uid {STRANGER}", marks=as_root
        ),
    ],
    ids=["symlink", "hardlink", "pipe", "folder", "stranger"],
)
def test_a_lock_that_somebody_else_made(
    path: Path, lock: Path, make: Callable[[Path, Path], object], why: str
) -> None:
    other = path.with_name("precious")
    other.write_text("precious")
    make(lock, other)
    said = refusal(path)
    assert said.startswith(f"can't lock '{lock}': ")
    assert why in said
    assert (other if other.exists() else lock).read_text() == "precious"
    assert not path.exists()


def test_a_path_too_long(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 108)
    assert "AF_UNIX path too long" in refusal(path)
    assert "at most 107" in refusal(None, {"BUSD_SOCKET": str(path)})
    assert not list(tmp_path.iterdir())


def test_the_default_folder_is_made(tmp_path: Path, environ: dict[str, str]) -> None:
    folder = tmp_path / "busd"
    with open_listener(environ=environ) as listener:
        assert listener.path == folder / "0.sock"
        assert mode(folder) == 0o700
    folder.rmdir()
    # The folder stays the default one if the path is given. A client that starts a daemon does this.
    with open_listener(folder / "7.sock", environ={**environ, "BUSD_SOCKET": "/x", "BUSD_DOMAIN": "x"}):
        assert mode(folder) == 0o700


@pytest.mark.parametrize("wrong", [0o750, 0o701, 0o777, 0o1777])
def test_a_default_folder_open_to_others(tmp_path: Path, environ: dict[str, str], wrong: int) -> None:
    folder = tmp_path / "busd"
    folder.mkdir()
    folder.chmod(wrong)
    assert refusal(None, environ) == (
        f"busd refuses to open its socket in '{folder}' (owner uid {os.geteuid()}, mode {wrong:04o}): "
        "others may enter it; if you trust what is in it, chmod 700 it"
    )
    assert not list(folder.iterdir())


def test_a_default_folder_that_is_a_link(tmp_path: Path, environ: dict[str, str]) -> None:
    target = tmp_path / "target"
    target.mkdir(0o700)
    (tmp_path / "busd").symlink_to(target)
    assert "it is a symbolic link" in refusal(None, environ)
    assert not list(target.iterdir())
    target.rmdir()
    assert "it is a symbolic link" in refusal(None, environ)
    assert not target.exists()


def test_a_default_folder_that_anybody_can_exchange(tmp_path: Path, environ: dict[str, str]) -> None:
    tmp_path.chmod(0o777)
    assert "the folder above is world-writable without the sticky bit" in refusal(None, environ)
    tmp_path.chmod(0o1777)
    with open_listener(environ=environ) as listener:
        assert answers(listener.path)


@pytest.mark.parametrize("allowed", [0o700, 0o755, 0o775, 0o1777])
def test_a_named_folder_may_be_shared(tmp_path: Path, path: Path, allowed: int) -> None:
    tmp_path.chmod(allowed)
    (tmp_path / "link").symlink_to(tmp_path)
    with open_listener(tmp_path / "link" / "0.sock", environ={}):
        assert answers(path)


def test_a_named_folder_that_is_missing_or_open_to_all(tmp_path: Path, path: Path) -> None:
    assert "none': No such file" in refusal(tmp_path / "none" / "0.sock")
    tmp_path.chmod(0o777)
    assert "mode 0777): every user can replace files in it" in refusal(path)
    assert not list(tmp_path.iterdir())


@as_root
def test_a_folder_of_another_user(tmp_path: Path, environ: dict[str, str]) -> None:
    folder, link = tmp_path / "busd", tmp_path / "link"
    folder.mkdir(0o700)
    os.chown(folder, STRANGER, STRANGER)
    link.symlink_to(folder)
    told = f"(owner uid {STRANGER}, mode 0700): it belongs to another user than uid 0"
    assert f"'{folder}' {told}" in refusal(None, environ)
    assert f"'{folder}' {told}" in refusal(folder / "0.sock")
    assert f"'{link}' {told}" in refusal(link / "0.sock")
    assert not list(folder.iterdir())

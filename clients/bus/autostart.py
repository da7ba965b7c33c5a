"""Connects to the broker's socket, and starts a busd in the background where none listens.

Any number of processes may do this at once: each starts one, the daemon's lock lets one of them live, and
all connect to that one. Its readiness comes as sd_notify's READY=1.
"""

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from bus.errors import BrokerUnavailable
from bus.reach import NotNow, Patience, try_to_connect
from bus.trust import check_folder

BUSD = (sys.executable, "-P", "-m", "busd")
"""What starts busd: the one that is installed, whatever lies in the folder that we are in."""

IDLE_EXIT_S = 30
"""A busd that was started in the background leaves after so long without a connection."""

_START_S = 10.0
_ALREADY_RUNNING = 3  # busd.run.EXIT_ALREADY_RUNNING

_started: set[int] = set()
"""Process ids of the busds that this process started and that it has not seen end."""


def is_allowed(environ: Mapping[str, str] = os.environ) -> bool:
    """Whether a busd may be started: BUSD_AUTOSTART is not 0."""
    return environ.get("BUSD_AUTOSTART", "1") not in ("0", "no", "off", "false")


async def open_socket(path: Path, patience: Patience, *, may_start: bool = True) -> socket.socket:
    """A non-blocking socket connected to the broker at `path`; one is started, if it `may_start`.

    Raises BrokerUnavailable where none answers and none may be or could be started, or where `patience` ends.
    """
    try:
        return await _connect(path, patience)
    except (FileNotFoundError, ConnectionRefusedError):
        if not may_start:
            raise BrokerUnavailable(f"no busd listens on {path}") from None
        if not is_allowed():
            raise BrokerUnavailable(
                f"no busd listens on {path}; start one with: busd --socket {path}"
                " (or let programs start it: unset BUSD_AUTOSTART)"
            ) from None
    await start(path)
    patience.renew()
    while True:
        try:
            return await _connect(path, patience)
        except (FileNotFoundError, ConnectionRefusedError):
            # Another process's busd was first: it holds the lock, but may not listen yet.
            why = f"busd was started at {path} but does not answer: nothing listens there"
        await asyncio.sleep(patience.pause_s(why))


async def start(path: Path, options: Sequence[str] = ("--idle-exit", str(IDLE_EXIT_S))) -> None:
    """Start a busd at `path` in a session of its own; returns when it is ready, or another one was first.

    Its log goes beside the socket. Raises BrokerUnavailable with the reason where it ends or hangs.
    Cancellation: it goes on.
    """
    reap()
    log = path.with_suffix(".log")
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
        ready.bind("")  # an abstract address that the kernel chooses
        ready.setblocking(False)
        pid = _spawn(path, log, "@" + ready.getsockname()[1:].decode(), options)
        with contextlib.closing(_PidFile(pid)) as process:
            waits = {
                loop.create_task(loop.sock_recv(ready, 4096)),
                loop.create_task(process.wait()),
            }
            try:
                done, _ = await asyncio.wait(waits, timeout=_START_S, return_when=asyncio.FIRST_COMPLETED)
            finally:  # nobody may read from the descriptors any more when they are closed
                for task in waits:
                    task.cancel()
                await asyncio.gather(*waits, return_exceptions=True)
                status = process.exit_status()
                if status is None:
                    _started.add(pid)
    if not done:
        raise BrokerUnavailable(f"busd (pid {pid}) did not become ready within {_START_S:g} s; see {log}")
    if status not in (None, 0, _ALREADY_RUNNING):
        raise BrokerUnavailable(f"busd could not be started at {path}: {_last_line(log)}")


def reap() -> None:
    """Let go of the busds that this process started and that have ended; else they stay as zombies."""
    for pid in tuple(_started):
        try:
            has_ended = os.waitpid(pid, os.WNOHANG)[0] == pid
        except ChildProcessError:  # somebody else has waited for it, or we are a fork of its parent
            has_ended = True
        if has_ended:
            _started.discard(pid)


def _spawn(path: Path, log: Path, notify: str, options: Sequence[str]) -> int:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    check_folder(path.parent)
    environ = {**os.environ, "NOTIFY_SOCKET": notify}
    arguments = [*BUSD, "--socket", str(path), *options]
    # Appended to: those who come second say so in the log of the one that serves.
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW
    if not path.with_name(f"{path.name}.lock").exists():  # the last one left in order: a new log
        flags |= os.O_TRUNC
    return os.posix_spawn(
        sys.executable,
        arguments,
        environ,
        file_actions=[
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
            (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
            (os.POSIX_SPAWN_OPEN, 2, str(log), flags, 0o600),
        ],
        setsid=True,
    )


class _PidFile:
    """Waits for a child without a signal handler or a thread."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._fd = os.pidfd_open(pid)
        self._status: int | None = None

    async def wait(self) -> None:
        loop = asyncio.get_running_loop()
        ended = loop.create_future()
        loop.add_reader(self._fd, _settle, ended)
        try:
            await ended
        finally:
            loop.remove_reader(self._fd)

    def exit_status(self) -> int | None:
        """None while it runs."""
        if self._status is None:
            with contextlib.suppress(ChildProcessError):
                pid, status = os.waitpid(self._pid, os.WNOHANG)
                self._status = os.waitstatus_to_exitcode(status) if pid else None
        return self._status

    def close(self) -> None:
        os.close(self._fd)


def _settle(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


async def _connect(path: Path, patience: Patience) -> socket.socket:
    while True:
        try:
            return try_to_connect(path)
        except NotNow as error:
            why = str(error)
        await asyncio.sleep(patience.pause_s(why))


def _last_line(log: Path) -> str:
    try:
        lines = log.read_text(errors="replace").strip().splitlines()
    except OSError:
        return f"see {log}"
    return lines[-1].removeprefix("busd: ") if lines else f"see {log}"

"""Starts a busd in the background, for a program that found none.

Any number of processes may do this at once: each starts one, the daemon's lock lets one of them live, and
all connect to that one. Its readiness comes as sd_notify's READY=1.
"""

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bus.errors import BrokerUnavailable, ConfigurationError
from bus.link.socket_owner import prepare_folder
from bus.logger import get_logger
from bus.process.address import is_default_folder

if TYPE_CHECKING:  # for a program that starts one
    from pathlib import Path

BUSD = (sys.executable, "-P", "-m", "busd")
"""Starts the busd that is installed, whatever lies in the current folder."""

IDLE_EXIT_S = 30
"""A busd that was started in the background ends after so long without a connection."""

_START_S = 10.0
_TAIL_BYTES = 4096
_ALREADY_RUNNING = 3  # busd.run.EXIT_ALREADY_RUNNING

_started: set[int] = set()
"""Process ids of the busds that this process started and that it has not seen end."""


async def start(
    path: str | os.PathLike[str], options: Sequence[str] = ("--idle-exit", str(IDLE_EXIT_S))
) -> None:
    """Start a busd at `path` in a session of its own; returns when it is ready, or another one was first.

    Its log goes beside the socket. Raises BrokerUnavailable with the reason if it ends or hangs.
    Cancellation: it goes on.
    """
    from pathlib import Path

    from bus.process.logfile import log_path

    reap()
    path = Path(path)
    _prepare_folder(path.parent)
    try:
        log = _Log(log_path(path))
        try:
            status = await _start(path, log, options)
        finally:
            os.close(log.fd)
    except BrokerUnavailable:
        raise
    except OSError as error:  # out of descriptors or processes
        raise BrokerUnavailable(f"busd could not be started at {path}: {error.strerror or error}") from None
    if log.fault and status != _ALREADY_RUNNING:
        get_logger("bus").warning(f"busd has no file for its log, which is in memory: {log.fault}")


async def _start(path: "Path", log: "_Log", options: Sequence[str]) -> int | None:
    """Returns its exit status, None while it runs."""
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
        ready.bind("")  # an abstract address that the kernel chooses
        ready.setblocking(False)
        pid = _spawn(path, log.fd, "@" + ready.getsockname()[1:].decode(), options)
        with contextlib.closing(_PidFile(pid)) as process:
            waits = {
                loop.create_task(loop.sock_recv(ready, 4096)),
                loop.create_task(process.wait()),
            }
            try:
                done, _ = await asyncio.wait(waits, timeout=_START_S, return_when=asyncio.FIRST_COMPLETED)
            finally:  # no thread may read from the descriptors any more when they are closed
                for task in waits:
                    task.cancel()
                await asyncio.gather(*waits, return_exceptions=True)
                status = process.exit_status()
                if status is None:
                    _started.add(pid)
    if not done:
        where = f"/proc/{pid}/fd/2" if log.fault else log.path
        raise BrokerUnavailable(f"busd (pid {pid}) did not become ready within {_START_S:g} s; see {where}")
    if status not in (None, 0, _ALREADY_RUNNING):
        reason = log.last_line() or f"it ended with {status}, and said nothing"
        raise BrokerUnavailable(f"busd could not be started at {path}: {reason}")
    return status


def reap() -> None:
    """Let go of the busds that this process started and that have ended; else they stay as zombies."""
    for pid in tuple(_started):
        try:
            has_ended = os.waitpid(pid, os.WNOHANG)[0] == pid
        except ChildProcessError:  # other code has waited for it, or this process is a fork of its parent
            has_ended = True
        if has_ended:
            _started.discard(pid)


class _Log:
    """The stderr of a busd that is to be started: its log file, or memory where there can be none."""

    def __init__(self, path: "Path") -> None:
        from bus.process.logfile import open_in_memory, open_log

        self.path = path
        self.fault = ""
        try:
            self.fd = open_log(path)
        except ConfigurationError as error:
            self.fault = str(error)
            self.fd = open_in_memory()
        self._begin = os.fstat(self.fd).st_size

    def last_line(self) -> str:
        """The last lines since it was opened."""
        end = os.fstat(self.fd).st_size
        begin = max(self._begin, end - _TAIL_BYTES)
        lines = os.pread(self.fd, end - begin, begin).decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("busd: ") if lines else ""


def _prepare_folder(folder: "Path") -> None:
    is_default = is_default_folder(folder)
    try:
        # busd has the configuration, which says whether others may read it.
        prepare_folder(folder, is_default=is_default, may_enter=0o055)
    except ConfigurationError as error:
        hint = "; remove it, or set BUSD_SOCKET" if is_default and os.path.lexists(folder) else ""
        raise BrokerUnavailable(f"no busd is started: {error}{hint}") from None


def _spawn(path: "Path", log_fd: int, notify: str, options: Sequence[str]) -> int:
    environ = {**os.environ, "NOTIFY_SOCKET": notify}
    arguments = [*BUSD, "--socket", str(path), *options]
    # The child opens nothing on its way to exec: an open that hangs would hold this process up, too.
    return os.posix_spawn(
        sys.executable,
        arguments,
        environ,
        file_actions=[
            (
                os.POSIX_SPAWN_DUP2,
                log_fd,
                2,
            ),  # first: without a stdin or stdout of ours it may be one of these
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
            (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
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

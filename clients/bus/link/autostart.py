"""Starts a busd in the background, for a program that found none.

Any number of processes may do this at once. Each starts a busd, the daemon's lock lets one of them run, and
all connect to that one. busd reports its readiness by sd_notify's READY=1.
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

if TYPE_CHECKING:  # only programs that start a busd need it
    from pathlib import Path

BUSD = (sys.executable, "-P", "-m", "busd")
"""The command of the installed busd; -P ignores modules in the current folder."""

IDLE_EXIT_S = 30
"""A busd in the background ends after this time without a connection."""

_START_S = 10.0
_TAIL_BYTES = 4096
_ALREADY_RUNNING = 3  # busd.run.EXIT_ALREADY_RUNNING

_started: set[int] = set()
"""Process ids of busds that this process started, and whose end it has not noticed yet."""


async def start(
    path: str | os.PathLike[str], options: Sequence[str] = ("--idle-exit", str(IDLE_EXIT_S))
) -> None:
    """Start a busd at `path` in a new session; returns when it is ready, or another busd was first.

    Its log is beside the socket. Raises BrokerUnavailable with the reason if busd ends or hangs.
    Cancellation: the started busd continues.
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
    """Start busd and wait until it is ready. Returns its exit status, None while it runs."""
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
            finally:  # before the descriptors are closed, no thread may read from them any more
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
    """Wait for ended busds that this process started; otherwise they stay as zombies."""
    for pid in tuple(_started):
        try:
            has_ended = os.waitpid(pid, os.WNOHANG)[0] == pid
        except ChildProcessError:  # other code has waited for it, or this process is a fork of its parent
            has_ended = True
        if has_ended:
            _started.discard(pid)


class _Log:
    """The stderr of a new busd: its log file, or memory if it can't have one."""

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
        """The last line written since the log was opened."""
        end = os.fstat(self.fd).st_size
        begin = max(self._begin, end - _TAIL_BYTES)
        lines = os.pread(self.fd, end - begin, begin).decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("busd: ") if lines else ""


def _prepare_folder(folder: "Path") -> None:
    is_default = is_default_folder(folder)
    try:
        # busd reads the configuration, which decides whether other users may enter.
        prepare_folder(folder, is_default=is_default, may_enter=0o055)
    except ConfigurationError as error:
        hint = "; remove it, or set BUSD_SOCKET" if is_default and os.path.lexists(folder) else ""
        raise BrokerUnavailable(f"no busd is started: {error}{hint}") from None


def _spawn(path: "Path", log_fd: int, notify: str, options: Sequence[str]) -> int:
    environ = {**os.environ, "NOTIFY_SOCKET": notify}
    arguments = [*BUSD, "--socket", str(path), *options]
    # The child opens only /dev/null before exec: an open that hangs would delay this process, too.
    return os.posix_spawn(
        sys.executable,
        arguments,
        environ,
        file_actions=[
            (
                os.POSIX_SPAWN_DUP2,
                log_fd,
                2,
            ),  # first: if our stdin or stdout is closed, the log may have that number
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
        """The exit status; None while the child runs."""
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

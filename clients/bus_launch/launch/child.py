"""A process that a launch has started: its output, its end, signals for it and its child processes.

Each process leads its own process group, and signals go to the group: a shell's programs get them, too.
The terminal's Ctrl-C reaches only the launch, which passes it on. Must not know: events, actions, and the
printed text.
"""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from bus_launch import warm

__all__ = ["Child", "end_all", "running", "signal_all"]

_CHUNK: Final = 1 << 16
_GUARD: Final = Path(__file__).with_name("guard.py")

running: Final[set["Child"]] = set()
"""Processes with an end that is not noticed yet."""


class Child:
    """The constructor starts the process, and raises OSError if that fails. Needs a running event loop."""

    def __init__(
        self,
        command: Sequence[str] | str,
        *,
        cwd: str | None,
        env: Mapping[str, str] | None,
        emulate_tty: bool,
    ) -> None:
        """`command`: words, or a line for the shell. `emulate_tty`: it writes to terminals."""
        ours, theirs = _terminals() if emulate_tty else _pipes()
        try:
            self._process: warm.Forked | subprocess.Popen[bytes] = self._fork(
                command, cwd, env, theirs
            ) or subprocess.Popen(
                command,
                shell=isinstance(command, str),
                cwd=cwd,
                env=env,
                stdin=subprocess.PIPE,  # the launch writes nothing: a reader waits
                stdout=theirs[0],
                stderr=theirs[1],
                process_group=0,
            )
        except BaseException:
            for fd in ours:
                os.close(fd)
            raise
        finally:
            for fd in theirs:
                os.close(fd)
        self.pid = self._process.pid
        self.stdout = _Stream(ours[0])
        self.stderr = _Stream(ours[1])
        try:
            _guard.add(self.pid)
        except BaseException:  # the guard could not be started; nothing else would end this process
            self.send_signal(signal.SIGKILL)
            self._process.wait()
            self.close()
            raise
        running.add(self)

    @staticmethod
    def _fork(
        command: Sequence[str] | str, cwd: str | None, env: Mapping[str, str] | None, outputs: Sequence[int]
    ) -> warm.Forked | None:
        if isinstance(command, str) or cwd is not None:
            return None
        return warm.fork(command, env, *outputs)

    async def wait(self) -> int:
        """Until it has ended; returns its exit code, or minus the number of the signal that ended it."""
        try:
            fd = os.pidfd_open(self.pid)
        except (AttributeError, OSError):
            code = await asyncio.to_thread(self._process.wait)
        else:
            try:
                await _readable(fd)
            finally:
                os.close(fd)
            code = self._process.wait()
        running.discard(self)
        if not self.has_group:
            _guard.remove(self.pid)
        return code

    @property
    def has_group(self) -> bool:
        """Whether it, or a process that it has started, still runs."""
        try:
            os.killpg(self.pid, 0)
        except OSError:
            return False
        return True

    def send_signal(self, number: int) -> None:
        """Send it to the process and its children; raises ProcessLookupError if no process is left."""
        os.killpg(self.pid, number)

    def close(self) -> None:
        """Let go of its pipes."""
        self.stdout.close()
        self.stderr.close()
        if self._process.stdin is not None:
            self._process.stdin.close()


class _Stream:
    """Our end of a pipe or terminal."""

    def __init__(self, fd: int) -> None:
        os.set_blocking(fd, False)
        self._fd = fd

    async def read(self) -> bytes:
        """What is there, or comes next; nothing at its end."""
        while self._fd >= 0:
            try:
                return os.read(self._fd, _CHUNK)
            except BlockingIOError:
                await _readable(self._fd)
            except OSError:
                break  # a terminal without a writer
        return b""

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


async def _readable(fd: int) -> None:
    loop = asyncio.get_running_loop()
    ready = loop.create_future()
    loop.add_reader(fd, _set, ready)
    try:
        await ready
    finally:
        loop.remove_reader(fd)


def _set(ready: "asyncio.Future[None]") -> None:
    if not ready.done():
        ready.set_result(None)


def _pipes() -> tuple[list[int], list[int]]:
    pairs = [os.pipe(), os.pipe()]
    return [ours for ours, _ in pairs], [theirs for _, theirs in pairs]


def _terminals() -> tuple[list[int], list[int]]:
    import pty
    import tty

    pairs = [pty.openpty(), pty.openpty()]
    for _, theirs in pairs:
        tty.setraw(theirs)  # lines end as the program ends them
    return [ours for ours, _ in pairs], [theirs for _, theirs in pairs]


class _Guard:
    """A process that ends the others when this one is gone, however that happened."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def add(self, group: int) -> None:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(_GUARD)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,
            )
        self._write_line(f"+{group}\n")

    def remove(self, group: int) -> None:
        self._write_line(f"-{group}\n")

    async def end(self) -> None:
        """Have it end the remaining processes; returns when there are none."""
        if self._process is None or running:
            return
        process, self._process = self._process, None
        assert process.stdin is not None
        try:
            process.stdin.close()
        except BrokenPipeError:
            pass
        await asyncio.to_thread(process.wait)

    def _write_line(self, line: str) -> None:
        if self._process is None or self._process.stdin is None:
            return
        try:
            self._process.stdin.write(line.encode())
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the guard was killed


_guard: Final = _Guard()


async def end_all() -> None:
    """At the end of a launch: end the processes of groups without a leader, too, in 5 s at most."""
    warm.end()
    await _guard.end()


def signal_all(number: signal.Signals) -> None:
    for child in list(running):
        try:
            child.send_signal(number)
        except ProcessLookupError:
            pass

"""Starts busd and programs as separate processes, on a separate bus, and ends all of them.

demo.py and robot/main.py use it. Users do not need it: they open a terminal for each program.
"""

import asyncio
import os
import signal
import socket
import sys
from asyncio.subprocess import Process
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self, TypeVar

import bus

T = TypeVar("T")

START_S = 20.0
"""Longer than the start of any program on a busy machine."""
_STOP_S = 5.0


class Failure(Exception):
    """The demonstration can't continue; the text has the reason."""


class Launch:
    """A busd on a socket in a new folder. This process and its children find it through BUSD_SOCKET.

    The end of the `async with` block ends the programs, then busd, and removes the folder.
    """

    def __init__(self) -> None:
        self._folder = TemporaryDirectory(prefix="busd-")
        self.folder = Path(self._folder.name)
        self.socket = self.folder / "busd.sock"
        self.ended: asyncio.Queue[str] = asyncio.Queue()
        """Name and end of each program that ended unexpectedly."""
        self._programs: dict[str, Process] = {}
        self._stopping: set[str] = set()
        self._watchers: list[asyncio.Task[None]] = []

    async def start(self, name: str, *command: str | Path, stderr: int | None = None) -> None:
        """Start `python <command>`; its stderr goes to the descriptor `stderr`, if given."""
        await self.start_program(name, sys.executable, *command, stderr=stderr)

    async def start_program(self, name: str, *command: str | Path, stderr: int | None = None) -> None:
        """The same for a program of any language."""
        # With a new session, Ctrl-C in the terminal only reaches this process, which ends the programs in
        # order.
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.DEVNULL, stderr=stderr, start_new_session=True
        )
        self._programs[name] = process
        self._watchers.append(asyncio.create_task(self._watch(name, process)))

    async def stop(self, name: str, number: signal.Signals) -> int:
        """Send a signal to a program and wait for its end; returns its status. Kills it after a time
        limit."""
        process = self._programs[name]
        self._stopping.add(name)
        with suppress(ProcessLookupError):
            process.send_signal(number)
        try:
            return await asyncio.wait_for(process.wait(), _STOP_S)
        except TimeoutError:
            process.kill()
            return await process.wait()

    async def during(
        self, work: Coroutine[Any, Any, T], what: str = "", *, limit_s: float | None = None
    ) -> T:
        """The result of `work`, which waits for `what`. Raises Failure if a program ends, or after
        `limit_s`."""
        task, ended = asyncio.create_task(work), asyncio.create_task(self.ended.get())
        try:
            await asyncio.wait({task, ended}, timeout=limit_s, return_when=asyncio.FIRST_COMPLETED)
            if ended.done():
                raise Failure(ended.result())
            if not task.done():
                raise Failure(f"waited {limit_s:g} s in vain for {what}")
            return task.result()
        finally:
            task.cancel()
            ended.cancel()

    async def __aenter__(self) -> Self:
        os.environ |= {"BUSD_SOCKET": str(self.socket), "BUSD_AUTOSTART": "0"}
        try:
            await self._start_busd()
        except BaseException:
            await self.__aexit__(None, None, None)
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            # SIGTERM ends a program without output at any moment, even during its imports. busd ends last.
            *programs, broker = reversed(self._programs)
            await asyncio.gather(*(self.stop(name, signal.SIGTERM) for name in programs))
            await self.stop(broker, signal.SIGTERM)
        finally:
            for process in self._programs.values():
                if process.returncode is None:
                    process.kill()
            self._folder.cleanup()

    async def _start_busd(self) -> None:
        notify = self.folder / "ready"
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
            ready.bind(str(notify))
            ready.setblocking(False)
            os.environ["NOTIFY_SOCKET"] = str(notify)
            await self.start("busd", "-m", "busd", "--log-level", "warn")
            del os.environ["NOTIFY_SOCKET"]
            await self.during(asyncio.get_running_loop().sock_recv(ready, 4096), "busd", limit_s=START_S)

    async def _watch(self, name: str, process: Process) -> None:
        status = await process.wait()
        if name not in self._stopping:
            how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"exited with {status}"
            self.ended.put_nowait(f"{name} {how}")


def run(main: Coroutine[Any, Any, int], *, if_interrupted: int) -> int:
    """Run `main` and return its exit status. Ctrl-C, SIGTERM and the terminal's end stop it in order; then
    returns `if_interrupted`."""
    # Background jobs of a script ignore SIGINT, and their children would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    try:
        return bus.run(main)
    except KeyboardInterrupt:  # also raised for SIGTERM
        return if_interrupted

"""The process of the client under test: its start, its output and its end."""

import asyncio
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from bus_cli.doctor.conformance.options import PLACE

__all__ = ["Client"]

_END_S = 2.0
_CLOSED_S = 0.5
_MOST_OUTPUT = 64 << 10


class Client:
    """Runs `command`, for the socket at `path`, from `start` to `stop`."""

    def __init__(self, command: Sequence[str], path: Path) -> None:
        self._path = path
        self._command = [word.replace(PLACE, str(path)) for word in command]
        self.output = ""
        """The end of its output on stdout and stderr."""

    async def start(self) -> None:
        """Start it. Raises OSError if that is impossible."""
        self._process = await asyncio.create_subprocess_exec(
            *self._command,
            env={**os.environ, "BUSD_SOCKET": str(self._path)},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )
        self._reading = asyncio.ensure_future(self._read_output())

    async def stop(self) -> None:
        """End it by SIGTERM; by SIGKILL if that does not end it."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), _END_S)
                break
        with suppress(TimeoutError):  # a process that it has started may still have the pipe
            await asyncio.wait_for(self._reading, _END_S)

    @property
    def status(self) -> int | None:
        """The exit status, or minus the number of the signal that ended it; None while it runs."""
        return self._process.returncode

    async def wait_for_end(self) -> None:
        """Wait a moment whether it ends."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), _CLOSED_S)

    def end_in_words(self) -> str:
        """How it has ended."""
        if self.status is None:
            return "the client runs"
        if self.status < 0:
            return f"the client was ended by {signal.Signals(-self.status).name}"
        return f"the client ended with status {self.status}"

    async def _read_output(self) -> None:
        assert self._process.stdout is not None
        while raw := await self._process.stdout.read(4096):
            self.output = (self.output + raw.decode(errors="replace"))[-_MOST_OUTPUT:]

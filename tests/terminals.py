"""A program at its own terminal: its keys, and its display."""

import os
import pty
import re
import select
import sys
import termios
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from conftest import WAIT_S

__all__ = ["OwnTerminal"]


class OwnTerminal:
    """A Python program in the foreground of a terminal, until the end of the block."""

    def __init__(self, *words: str) -> None:
        self._text = ""
        self._pid, self._end = pty.fork()
        if not self._pid:
            try:
                os.execv(sys.executable, [sys.executable, *words])
            finally:
                os._exit(127)  # a second pytest must not continue here

    def read_until(self, pattern: str) -> str:
        """Read until this is shown after earlier output; returns the output up to there.

        Raises TimeoutError.
        """
        end = time.monotonic() + WAIT_S
        while not (found := re.search(pattern, self._text)):
            if time.monotonic() > end or not select.select([self._end], [], [], WAIT_S)[0]:
                raise TimeoutError(f"no {pattern!r} in {self._text!r}")
            self._text += os.read(self._end, 1 << 16).decode()
        read, self._text = self._text[: found.end()], self._text[found.end() :]
        return read

    def write(self, keys: str | bytes) -> None:
        os.write(self._end, keys if isinstance(keys, bytes) else keys.encode())

    def mode(self) -> list[Any]:
        """The terminal's settings for input."""
        return termios.tcgetattr(self._end)

    def is_raw(self) -> bool:
        """Whether input is neither echoed nor gathered into lines."""
        return not self.mode()[3] & (termios.ICANON | termios.ECHO)

    def send_signal(self, number: int) -> None:
        os.kill(self._pid, number)

    def wait(self) -> int:
        """Wait for the program's end; returns its exit code.

        Raises TimeoutError, with the state of the process. Without it, pytest-timeout ends the worker.
        """
        descriptor = os.pidfd_open(self._pid)
        try:
            if not select.select([descriptor], [], [], WAIT_S)[0]:
                raise TimeoutError(f"it goes on: {Path(f'/proc/{self._pid}/status').read_text()}")
        finally:
            os.close(descriptor)
        _, status = os.waitpid(self._pid, 0)
        self._pid = 0
        return os.waitstatus_to_exitcode(status)

    def close(self) -> None:
        """Close the terminal's window."""
        os.close(self._end)
        self._end = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pid:
            os.kill(self._pid, 9)
            self.wait()
        if self._end >= 0:
            os.close(self._end)

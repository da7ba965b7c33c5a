"""Reads keys of a terminal on the event loop; restores the terminal at every end or stop of the program.

Owns: the terminal's mode, and the signals that would leave it changed. Must not know the meaning of keys.
"""

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

from bus_bag.terminal.foreground import is_in_foreground

__all__ = ["Keyboard"]

_DEADLY = ("SIGHUP", "SIGQUIT", "SIGTERM", "SIGINT", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF")
"""Signals that end a program without a handler."""
_LOOK_S = 0.5
"""Period in which a program in the background checks whether it is in the foreground."""


class Keyboard:
    """Passes typed keys to `read`, key by key, without an echo, until `close`.

    It only does so while the program is in the foreground of its terminal. `stopped` is called before Ctrl-Z
    stops the program, and `continued` when it continues. Make it on the main thread.
    """

    def __init__(
        self,
        read: Callable[[bytes], None],
        stopped: Callable[[], None] = lambda: None,
        continued: Callable[[], None] = lambda: None,
    ) -> None:
        import termios

        self._termios = termios
        self._read = read
        self._stopped = stopped
        self._continued = continued
        self._loop = asyncio.get_running_loop()
        self._terminal = sys.stdin.fileno()
        self._before: list[Any] | None = None
        self._is_attached = False
        self._handlers: dict[int, Any] = {}
        for name in _DEADLY:
            number = getattr(signal, name)
            if signal.getsignal(number) is signal.SIG_DFL:
                self._handlers[number] = signal.signal(number, self._die)
        self._is_stoppable = signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL
        if self._is_stoppable:
            self._loop.add_signal_handler(signal.SIGTSTP, self._stop)
        self._loop.add_signal_handler(signal.SIGCONT, self._continue)
        self._look: asyncio.TimerHandle | None = None
        self._attach()

    @staticmethod
    def is_there() -> bool:
        """Whether the standard input is a terminal."""
        return sys.stdin is not None and sys.stdin.isatty()

    def close(self) -> None:
        """Restore the terminal."""
        self._detach()
        if self._look is not None:
            self._look.cancel()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()
        if self._is_stoppable:
            self._loop.remove_signal_handler(signal.SIGTSTP)
        self._loop.remove_signal_handler(signal.SIGCONT)

    def _attach(self) -> None:
        """Start to read keys when in the foreground: in the background this would stop the program."""
        if self._look is not None:
            self._look.cancel()
        if not is_in_foreground(self._terminal):
            self._look = self._loop.call_later(_LOOK_S, self._attach)  # a shell's `fg` may send no signal
            return
        termios = self._termios
        now = termios.tcgetattr(self._terminal)
        if not self._is_attached:  # until then the shell may have its own mode
            self._before = termios.tcgetattr(self._terminal)
        now[3] &= ~(termios.ICANON | termios.ECHO)
        now[6][termios.VMIN], now[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._terminal, termios.TCSANOW, now)
        if not self._is_attached:
            self._loop.add_reader(self._terminal, self._on_input)
            self._is_attached = True

    def _detach(self) -> None:
        if not self._is_attached:
            return
        self._is_attached = False
        self._loop.remove_reader(self._terminal)
        self._put_back()

    def _put_back(self) -> None:
        with suppress(OSError, self._termios.error):
            if self._before is not None and is_in_foreground(self._terminal):
                self._termios.tcsetattr(self._terminal, self._termios.TCSANOW, self._before)

    def _on_input(self) -> None:
        data = b""
        if is_in_foreground(self._terminal):
            with suppress(OSError):
                data = os.read(self._terminal, 64)
        if data:
            self._read(data)
        else:  # the terminal has gone, or belongs to another program now
            self._detach()
            self._attach()

    def _die(self, number: int, frame: FrameType | None) -> None:
        self._put_back()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)

    def _stop(self) -> None:
        self._stopped()
        self._detach()
        self._loop.remove_signal_handler(signal.SIGTSTP)
        signal.raise_signal(signal.SIGTSTP)
        # The program continues here after SIGCONT.
        self._loop.add_signal_handler(signal.SIGTSTP, self._stop)

    def _continue(self) -> None:
        self._attach()
        self._continued()

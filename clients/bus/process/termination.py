"""Ends a program by a signal: without a traceback, and with the same signal reported to its parent.

A shell continues its loop, and a supervisor sees a failure, depending on the status from `waitpid`. So a
program ended by a signal cleans up and then dies by that signal. For SIGINT Python does this itself, unless
the program catches the KeyboardInterrupt. Owns the same for SIGTERM and SIGPIPE, and suppresses their
tracebacks.
"""

import sys
from types import TracebackType
from typing import NoReturn

__all__ = [
    "ReaderGone",
    "Terminated",
    "die_at_exit",
    "die_at_interrupt",
    "die_now",
    "drop_unread_output",
    "heed_interrupts",
    "is_dying",
    "say_nothing_of_signals",
]


class Terminated(KeyboardInterrupt):
    """SIGTERM came. A program that ends in order at Ctrl-C does the same for it."""


class ReaderGone(KeyboardInterrupt):
    """SIGPIPE came: stdout or stderr is a pipe that no process reads any more, for example after `| head
    -1`."""


def drop_unread_output() -> bool:
    """Whether stdout or stderr is a pipe without a reader. Discards the output to such a stream from now on.

    Otherwise Python would fail again, and print an error, when it writes the rest of its buffers at the end.
    """
    import os
    import select

    unread = False
    for stream in (1, 2):
        poll = select.poll()
        poll.register(stream, 0)
        if any(event & select.POLLERR for _, event in poll.poll(0)):
            unread = True
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream)
            os.close(nowhere)
    return unread


def say_nothing_of_signals() -> None:
    """Print no traceback for an uncaught KeyboardInterrupt.

    A Terminated ends the process by SIGTERM, a ReaderGone by SIGPIPE.
    """
    before = sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if kind not in (KeyboardInterrupt, Terminated, ReaderGone):
            before(kind, error, trace)
            return
        import signal

        die_at_interrupt()
        if kind is not KeyboardInterrupt:
            die_at_exit(signal.SIGTERM if kind is Terminated else signal.SIGPIPE)

    sys.excepthook = hook


def die_at_interrupt() -> None:
    """Let a Ctrl-C end this process at once, without a KeyboardInterrupt. If it was ignored, that stays."""
    import signal

    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def heed_interrupts() -> None:
    """Undo `die_at_interrupt`: a Ctrl-C raises KeyboardInterrupt again, and programs can tidy up."""
    import signal

    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def die_at_exit(number: int) -> None:
    """Let this process die by a signal after Python's shutdown.

    Exit handlers run before that, and open files are flushed.
    """
    # Python destroys the attributes of `sys` last.
    setattr(sys, _Death.__name__, _Death(number))


def is_dying() -> bool:
    """Whether `die_at_exit` was called."""
    return hasattr(sys, _Death.__name__)


def die_now(number: int) -> NoReturn:
    """Die by a signal at once. The caller has flushed its output."""
    import os
    import signal

    signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [number])
    signal.raise_signal(number)
    os._exit(128 + number)  # for a signal that is ignored by default


class _Death:
    """An object whose destruction ends the process."""

    def __init__(self, number: int) -> None:
        import signal

        signal.signal(number, signal.SIG_DFL)
        self._number = number
        self._raise = signal.raise_signal  # modules no longer exist at the call

    def __del__(self) -> None:
        self._raise(self._number)

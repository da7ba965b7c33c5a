"""Deferral of Ctrl-C and SIGTERM while an exception would be lost, or leave a child that no Group knows."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from bus.process.termination import Terminated

__all__ = ["deferred", "end_on_signals"]

_ENDING = (signal.SIGINT, signal.SIGTERM)


def end_on_signals() -> None:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt and Terminated, even if they were ignored before."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, _terminate)


@contextmanager
def deferred() -> Iterator[None]:
    """Raise a signal that arrives inside the block at its end, for work that must not stop half done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated

"""SIGINT and SIGTERM, as rclpy handles them: both end the contexts, and SIGINT raises KeyboardInterrupt."""

import asyncio
import signal
import threading
from collections.abc import Callable
from enum import IntEnum
from types import FrameType
from typing import Any, NamedTuple

from bus_ros import engine as engines
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.destroyable import Handled

__all__ = [
    "SignalHandlerGuardCondition",
    "SignalHandlerOptions",
    "get_current_signal_handlers_options",
    "install_signal_handlers",
    "uninstall_signal_handlers",
]


class SignalHandlerOptions(IntEnum):
    """Signals that `rclpy.init` handles."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


class SignalHandlerGuardCondition(Handled):
    """rclpy's guard condition to wake executors at a signal; executors here do not need it."""

    def __init__(self, context: Context | None = None) -> None:
        self.is_destroyed = False

    def trigger(self) -> None:
        """Raises InvalidHandle if it is destroyed."""
        self.handle.check()

    def destroy(self) -> None:
        self.is_destroyed = True


_installed = SignalHandlerOptions.NO
_before: dict[int, Any] = {}
_came: int | None = None
_deferred: "_Deferred | None" = None


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Handle signals, for all contexts; does nothing outside of the main thread."""
    global _installed, _came, _deferred
    if threading.current_thread() is not threading.main_thread():
        return
    _came = _deferred = None
    for option, number, handler in _HANDLERS:
        if options & option and number not in _before:
            _before[number] = signal.signal(number, handler)
            _installed = SignalHandlerOptions(_installed | option)


def uninstall_signal_handlers() -> None:
    """Restore the previous handlers."""
    global _installed
    if threading.current_thread() is not threading.main_thread():
        return
    for _, number, handler in _HANDLERS:
        if number in _before:
            before = _before.pop(number)
            if signal.getsignal(number) is handler:
                signal.signal(number, before)
    _installed = SignalHandlerOptions.NO


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """The signals that are handled now."""
    return _installed


def last_signal() -> int | None:
    """The signal that ended the contexts since handlers were installed; None if there was none."""
    return _came


class _Deferred(NamedTuple):
    """Raises KeyboardInterrupt between two turns of an event loop, unless that stops before."""

    loop: asyncio.AbstractEventLoop
    handle: asyncio.Handle


def _on_sigint(number: int, frame: FrameType | None) -> None:
    _end_contexts(number)
    engine = engines.current()
    if engine is not None and engine.is_busy(frame):
        engine.interrupt()
        return
    if engine is not None:
        engine.loop.is_interrupted = False  # a pending interrupt and this one count as one
    before = _before.get(number)
    if callable(before) and before is not signal.default_int_handler:
        before(number, frame)
    elif not _interrupt_between_turns(None if engine is None else engine.loop):
        raise KeyboardInterrupt


def _interrupt_between_turns(own_loop: asyncio.AbstractEventLoop | None) -> bool:
    """Raise KeyboardInterrupt between two turns of the main thread's event loop; False without such a loop.

    In the middle of a task, the exception would also be that task's result, and asyncio would report it once
    more. `asyncio.run` avoids that if `rclpy.init` has not been called before. A second signal does not wait.
    In a callback of an executor, whose loop is `own_loop`, the exception comes at once.
    """
    global _deferred
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        loop = None
    before, _deferred = _deferred, None
    if before is not None:
        before.handle.cancel()
        if before.loop is loop:
            return False
    if loop is None or loop is own_loop:
        return False
    _deferred = _Deferred(loop, loop.call_soon_threadsafe(_interrupt))
    return True


def _interrupt() -> None:
    global _deferred
    _deferred = None
    raise KeyboardInterrupt


def _on_sigterm(number: int, frame: FrameType | None) -> None:
    _end_contexts(number)
    before = _before.get(number)
    if callable(before):
        before(number, frame)


def _end_contexts(number: int) -> None:
    global _came
    _came = number
    for context in Context.all():
        context.end_by_signal()


_HANDLERS: tuple[tuple[SignalHandlerOptions, int, Callable[[int, FrameType | None], None]], ...] = (
    (SignalHandlerOptions.SIGINT, signal.SIGINT, _on_sigint),
    (SignalHandlerOptions.SIGTERM, signal.SIGTERM, _on_sigterm),
)

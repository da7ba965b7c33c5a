"""The base of all filters: callbacks, which get the outputs."""

from collections.abc import Callable
from typing import Any

__all__ = ["SimpleFilter"]


class SimpleFilter:
    """Calls registered callbacks with each of its outputs."""

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., object], *args: Any) -> int:
        """Call `cb` with the messages of each output, and then `args`. Returns its key in `callbacks`."""
        key = max(self.callbacks, default=-1) + 1
        self.callbacks[key] = (cb, args)
        return key

    def signalMessage(self, *msg: Any) -> None:
        """Put out one message of each input. After an exception in a callback, the others are not called."""
        for callback, args in tuple(self.callbacks.values()):
            callback(*msg, *args)

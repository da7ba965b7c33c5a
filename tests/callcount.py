"""Counts the calls of a block: of Python, native ones, and from one file to another.

    with CallCounter() as counter:
        publisher.publish(message)
    assert counter.python <= 20

The counts do not depend on the load of the machine, so tests use them as bounds. A resumed generator is a
call, too. Calls by the event loop and by threads do not count, nor do the test's own calls.
"""

import gc
import sys
from itertools import pairwise
from types import FrameType
from typing import Any, Self

_OTHERS = frozenset(
    {"abc", "asyncio", "concurrent", "contextvars", "functools", "inspect", "queue", "selectors", "threading"}
    | {"weakref", __name__}
)


class CallCounter:
    """`calls`: the file and the function of each call of Python, in order."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, str]] = []
        self.native = 0

    def __enter__(self) -> Self:
        self._collects = gc.isenabled()
        gc.disable()  # a collection calls finalizers of other tests' objects
        sys.setprofile(self._note)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        if self._collects:
            gc.enable()

    @property
    def python(self) -> int:
        return len(self.calls)

    @property
    def switches(self) -> int:
        """How often a call leads to a function in another file than the previous call."""
        files = [file for file, _ in self.calls]
        return sum(one != other for one, other in pairwise(files))

    def _note(self, frame: FrameType, event: str, argument: Any) -> None:
        names = frame.f_globals.get("__name__", "").split(".")
        if names[0] in _OTHERS or names[-1].startswith(("test_", "conftest")):
            return
        if event == "call":
            self.calls.append((frame.f_code.co_filename, frame.f_code.co_qualname))
        elif event == "c_call":
            self.native += 1

"""Texts and warnings about nodes that a program never closes, or opens twice.

Knows a node by its name and by the line that made it.
"""

import gc
import sys
import warnings
from collections import deque
from collections.abc import Callable
from types import FrameType

from bus.errors import ForkError
from bus.link.declarations import LinkNode
from bus.link.link import Link
from bus.logger import get_logger

__all__ = ["CloseReminder", "call_site", "warn_of_namesake"]

_log = get_logger("bus")

_namesakes: set[str] = set()
"""Full names that the log has reported as open twice in this process."""

_after_collection: deque[Callable[[], None]] = deque()
"""Work for the end of the collection that has found a node."""


class CloseReminder:
    """Acts if a program drops `node` without closing it.

    `must_be_closed`: it warns. Otherwise it closes the node without a message.
    """

    def __init__(self, node: LinkNode, *, must_be_closed: bool) -> None:
        self.must_be_closed = must_be_closed
        self.how_to_close = "use async with, or await its close()"
        self.when_dropped: Callable[[], object] | None = None
        """Called when the collector has found the node open."""
        self._node = node

    def found(self, owner: object, link: Link, let_go: Callable[[Link, object], None]) -> None:
        """After the collector has found the open node `owner`: warn, and have its loop call `let_go`."""
        if isinstance(link.failure, ForkError):
            return
        try:
            if self.must_be_closed:
                self.warn(owner)
        finally:  # warnings may be errors
            # At the program's end, the kernel closes the descriptors soon.
            if not sys.is_finalizing() or link.loop.is_closed():
                _do_after_collection(lambda: self._have_closed(link, let_go))

    def warn(self, owner: object) -> None:
        """Issue a ResourceWarning at the line that made the node, which no code can close any more."""
        node = self._node
        text = f"node {node.full_name} was never closed: {self.how_to_close}"
        warnings.warn_explicit(text, ResourceWarning, *node.made_at, source=owner)

    def report_dropped(self) -> None:
        """Log that the node is closed because the collector has found it: its callbacks end."""
        if not self.must_be_closed:
            return
        node = self._node
        path, line = node.made_at
        _log.warning(
            f"node {node.full_name}, made at {path}:{line}, is closed now, because nothing refers to it: "
            f"{self.how_to_close}"
        )

    def _have_closed(self, link: Link, let_go: Callable[[Link, object], None]) -> None:
        try:
            # This may be any thread, even during the link's own work.
            link.loop.call_soon_threadsafe(let_go, link, link.connection_now())
        except RuntimeError:  # the event loop is closed; its thread may have done so just now
            let_go(link, None)
            return
        if self.when_dropped is not None:
            self.when_dropped()


def _do_after_collection(work: Callable[[], None]) -> None:
    """Call `work` once no collection is in progress: in this call, or by the thread that collects.

    A collector that has found a node also closes the suspended coroutines of its callbacks. If the event
    loop, in another thread, cancelled their tasks meanwhile, they would fail: "coroutine already executing".
    """
    _after_collection.append(work)
    # It is never removed, because another thread may walk through that list.
    if _collected not in gc.callbacks:
        gc.callbacks.append(_collected)
    # During a collection this does nothing, and that one calls `_collected` at its end.
    gc.collect(0)


def _collected(phase: str, info: object) -> None:
    if phase == "stop":
        while _after_collection:
            _after_collection.popleft()()


def warn_of_namesake(node: LinkNode, link: Link) -> None:
    """Log, once for each name, that this process has a node with this name open on another link.

    busd reports all other nodes with the same name.
    """
    other = link.namesake(node)
    if other is not None and node.full_name not in _namesakes:
        _namesakes.add(node.full_name)
        path, line = other.made_at
        _log.warning(
            f"this process has another open node named {node.full_name}, made at {path}:{line}: "
            "close it first, or choose another name"
        )


def call_site(maker: object) -> tuple[str, int]:
    """File and line of the innermost caller outside the package `bus`.

    Constructors of classes derived from the class of `maker`, the object under construction, don't count.
    Takes less than a microsecond: it reads frames, no source files.
    """
    caller = sys._getframe(1)
    while _is_inside(caller, maker) and caller.f_back is not None:
        caller = caller.f_back
    return caller.f_code.co_filename, caller.f_lineno


def _is_inside(frame: FrameType, maker: object) -> bool:
    if frame.f_globals.get("__name__", "").partition(".")[0] == "bus":
        return True
    return frame.f_code.co_name == "__init__" and any(one is maker for one in frame.f_locals.values())

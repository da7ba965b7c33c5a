"""Texts and warnings about nodes that a program never closes, or opens twice.

Knows a node by its name and by the line that made it.
"""

import sys
import warnings
from collections.abc import Callable
from types import FrameType
from typing import Protocol

from bus.errors import ForkError
from bus.link.declarations import LinkNode
from bus.link.link import Link
from bus.logger import get_logger

__all__ = ["call_site", "found", "tell_dropped", "tell_namesake", "warn"]

_log = get_logger("bus")

_namesakes: set[str] = set()
"""Full names that the log has reported as open twice in this process."""


class Unclosed(LinkNode, Protocol):
    """A node, as these warnings see it."""

    _link: Link | None
    _must_be_closed: bool
    _how_to_close: str
    _when_dropped: Callable[[], None] | None

    def _let_go(self, link: Link, connection: object) -> None: ...


def found(node: Unclosed) -> None:
    """The finalizer of a node: nothing refers to it any more. Warn if it is open, and have it closed."""
    link = getattr(node, "_link", None)  # missing if the constructor raised
    if link is None or isinstance(link.failure, ForkError):
        return
    try:
        if node._must_be_closed:
            warn(node)
    finally:  # warnings may be errors
        # When the program ends, the kernel closes the descriptors in a moment.
        if not sys.is_finalizing() or link.loop.is_closed():
            _have_closed(node, link)


def _have_closed(node: Unclosed, link: Link) -> None:
    try:
        # The collector runs in any thread, also amid the link's own work.
        link.loop.call_soon_threadsafe(node._let_go, link, link.connection_now())
    except RuntimeError:  # the event loop is closed; its thread may have done so just now
        node._let_go(link, None)
        return
    if node._when_dropped is not None:
        node._when_dropped()


def warn(node: Unclosed) -> None:
    """A ResourceWarning at the line that made `node`, which nothing can close any more."""
    text = f"node {node.full_name} was never closed: {node._how_to_close}"
    warnings.warn_explicit(text, ResourceWarning, *node._made_at, source=node)


def tell_dropped(node: Unclosed) -> None:
    """Log that the node is closed because the collector has found it: its callbacks end."""
    path, line = node._made_at
    _log.warning(
        f"node {node.full_name}, made at {path}:{line}, is closed now, because nothing refers to it: "
        f"{node._how_to_close}"
    )


def tell_namesake(node: LinkNode, link: Link) -> None:
    """Log, once for each name, that this process has a node of this name open by another link.

    busd reports all other nodes of the same name.
    """
    other = link.namesake(node)
    if other is not None and node.full_name not in _namesakes:
        _namesakes.add(node.full_name)
        path, line = other._made_at
        _log.warning(
            f"this process has another open node named {node.full_name}, made at {path}:{line}: "
            "close it first, or choose another name"
        )


def call_site(maker: object) -> tuple[str, int]:
    """File and line of the innermost caller outside the package `bus`.

    Constructors of classes derived from that of `maker`, the object that is being made, don't count. Takes
    less than a microsecond: it reads frames, no source files.
    """
    caller = sys._getframe(1)
    while _is_inside(caller, maker) and caller.f_back is not None:
        caller = caller.f_back
    return caller.f_code.co_filename, caller.f_lineno


def _is_inside(frame: FrameType, maker: object) -> bool:
    if frame.f_globals.get("__name__", "").partition(".")[0] == "bus":
        return True
    return frame.f_code.co_name == "__init__" and any(one is maker for one in frame.f_locals.values())

"""bus.node.unclosed: the finalizer of a node that the program has not closed."""

from typing import Any

import pytest

from bus.link.declarations import LinkNode
from bus.node.unclosed import CloseReminder


class _Loop:
    """A loop that another thread closes just after a look at `is_closed`."""

    def is_closed(self) -> bool:
        return False

    def call_soon_threadsafe(self, *_: object) -> None:
        raise RuntimeError("Event loop is closed")


class _Link:
    failure = None
    loop = _Loop()

    def connection_now(self) -> object:
        return self


def _dropped() -> None:
    raise AssertionError("its loop has no more turns")


def test_an_event_loop_that_another_thread_closes_meanwhile() -> None:
    link: Any = _Link()
    reminder = CloseReminder(LinkNode("talker", "/", None, ("talker.py", 7)), must_be_closed=True)
    reminder.when_dropped = _dropped
    let_go: list[tuple[object, object]] = []
    with pytest.warns(ResourceWarning, match="node /talker was never closed"):
        reminder.found(reminder, link, lambda *what: let_go.append(what))
    assert let_go == [(link, None)]

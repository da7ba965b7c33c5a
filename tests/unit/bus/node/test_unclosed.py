"""bus.node.unclosed: the finalizer of a node that nobody has closed."""

from typing import Any

import pytest

from bus.node.unclosed import found


class _Loop:
    """Another thread closes it just after it was seen open."""

    def is_closed(self) -> bool:
        return False

    def call_soon_threadsafe(self, *_: object) -> None:
        raise RuntimeError("Event loop is closed")


class _Link:
    failure = None
    loop = _Loop()

    def connection_now(self) -> object:
        return self


class _Node:
    full_name = "/talker"
    _must_be_closed = True
    _how_to_close = "use async with"
    _made_at = ("talker.py", 7)

    def __init__(self) -> None:
        self._link = _Link()
        self.let_go: list[tuple[object, object]] = []

    def _let_go(self, link: object, connection: object) -> None:
        self.let_go.append((link, connection))

    def _when_dropped(self) -> None:
        raise AssertionError("its loop has no more turns")


def test_an_event_loop_that_another_thread_closes_meanwhile() -> None:
    node: Any = _Node()
    with pytest.warns(ResourceWarning, match="node /talker was never closed"):
        found(node)
    assert node.let_go == [(node._link, None)]

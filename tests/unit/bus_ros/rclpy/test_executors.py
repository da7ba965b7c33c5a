"""An executor, and entities of nodes that are added and removed, without a bus."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros import engine as engines
from bus_ros.entity import Entity, Work
from bus_ros.rclpy.executors import SingleThreadedExecutor


class Robot:
    """A node."""

    def __init__(self) -> None:
        self.own_executor: Any = None
        self.waiting: list[Entity] = []
        self.timers: tuple[Any, ...] = ()
        self.context: Any = SimpleNamespace()


class Box(Entity):
    """Calls its callback for each `put`."""

    def __init__(self, node: Any) -> None:
        super().__init__(node, None)
        self.full = 0

    def put(self) -> None:
        self.full += 1
        self.notify()

    def take(self, most: int) -> Work | None:
        if not self.full:
            return None
        self.full -= 1
        return int, ()


@pytest.fixture
def executor() -> Iterator[SingleThreadedExecutor]:
    yield SingleThreadedExecutor()
    engines.end()


def test_what_waits_for_an_executor_comes_in_the_order_in_which_it_was_made(
    executor: SingleThreadedExecutor,
) -> None:
    node: Any = Robot()
    first, second, idle = Box(node), Box(node), Box(node)
    for box in (second, first, second):
        box.put()
    assert list(executor.ready) == []
    assert executor.add_node(node)
    assert list(executor.ready) == [first, second] and not idle.is_queued
    executor.remove_node(node)
    assert list(executor.ready) == []
    idle.put()
    other = SingleThreadedExecutor()
    other.add_node(node)
    assert list(other.ready) == [first, second, idle]
    other.add_node(Robot())  # type: ignore[arg-type]
    assert list(other.ready) == [first, second, idle]


def test_only_what_may_have_something_is_looked_at(executor: SingleThreadedExecutor) -> None:
    node: Any = Robot()
    box, idle = Box(node), Box(node)
    looked: list[int] = []
    idle.take = looked.append  # type: ignore[assignment, method-assign]
    box.put()
    for _ in range(3):
        executor.add_node(node)
        with executor._engine.loop:
            while executor.ready:
                executor._next(0, 1, lambda: True)
        executor.remove_node(node)
    assert box.full == 0 and looked == []

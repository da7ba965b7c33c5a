"""An executor, and entities of nodes that are added and removed, without a bus."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros import engine as engines
from bus_ros.entity import Entity, Work
from bus_ros.rclpy.executors import SingleThreadedExecutor
from bus_ros.rclpy.timer import NEVER_NS


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


class Timer(Box):
    """A timer that is due as long as it is not queued and has calls left."""

    rank = 1
    is_timer = True
    is_single = True
    is_simulated = False

    def due_ns(self) -> int:
        return NEVER_NS if self.is_queued or not self.full else 0


class Filled(Box):
    """A box of another kind."""

    def __init__(self, node: Any, rank: int) -> None:
        self.rank = rank
        super().__init__(node)


def calls(executor: SingleThreadedExecutor, most: int) -> list[Any]:
    """The entities of the next calls, in order."""
    found: list[Any] = []
    with executor._engine.loop:
        while len(found) < most and (call := executor._next(0, 1, lambda: True)) is not None:
            found.append(call[0])
    return found


def test_a_round_has_the_order_of_kinds(executor: SingleThreadedExecutor) -> None:
    node: Any = Robot()
    executor.add_node(node)
    kinds = [Filled(node, rank) for rank in (5, 4, 3, 2, 2, 0)]
    timer = Timer(node)
    node.timers = (timer,)
    timer.full = 1
    for box in kinds:
        box.put()
    service, client, guard, first, second, event = kinds
    task = executor.create_task(int)
    found = calls(executor, 10)
    assert found[0].task is task
    assert found[1:] == [event, timer, first, second, guard, client, service]


def test_a_due_timer_comes_before_messages_and_does_not_starve_them(executor: SingleThreadedExecutor) -> None:
    node: Any = Robot()
    executor.add_node(node)
    timer, many, few = Timer(node), Filled(node, 2), Filled(node, 2)
    node.timers = (timer,)
    many.full, timer.full = 100, 3
    many.put()
    few.put()
    executor.on_timers_changed()
    assert calls(executor, 8) == [timer, many, few, timer, many, timer, many, many]


def test_a_timer_is_found_behind_an_entity_that_may_not_run(executor: SingleThreadedExecutor) -> None:
    node: Any = Robot()
    executor.add_node(node)
    held, timer = Filled(node, 0), Timer(node)
    node.timers = (timer,)
    timer.full = 2
    held.held_group = SimpleNamespace(can_execute=lambda entity: False)  # type: ignore[assignment]
    held.put()
    executor.asks_always = True
    executor.on_timers_changed()
    assert calls(executor, 3) == [timer, timer]
    assert list(executor.ready) == [held]


def test_a_timer_that_is_canceled_in_the_queue_does_not_hide_others(executor: SingleThreadedExecutor) -> None:
    """A past fault: the executor then waited without the time of the other timers."""
    node: Any = Robot()
    executor.add_node(node)
    canceled, other = Timer(node), Timer(node)
    node.timers = (canceled, other)
    canceled.full = 1

    def leave(most: int) -> None:
        canceled.full = 0
        other.full = 1

    canceled.take = leave  # type: ignore[method-assign]
    assert calls(executor, 2) == [other]


def test_a_timer_that_is_queued_as_its_node_leaves_runs_in_the_next_executor(
    executor: SingleThreadedExecutor,
) -> None:
    node: Any = Robot()
    timer = Timer(node)
    node.timers = (timer,)
    timer.full = 1
    executor.add_node(node)
    with executor._engine.loop:
        executor._collect_timers()
    assert list(executor.ready) == [timer]
    executor.remove_node(node)
    other = SingleThreadedExecutor()
    other.add_node(node)
    assert calls(other, 2) == [timer]


def test_an_entity_whose_take_raises_is_asked_again(executor: SingleThreadedExecutor) -> None:
    node: Any = Robot()
    executor.add_node(node)
    box = Box(node)
    take = box.take

    def fail(most: int) -> None:
        box.take = take  # type: ignore[method-assign]
        raise ValueError("no")

    box.take = fail  # type: ignore[method-assign]
    box.put()
    with pytest.raises(ValueError, match="no"):
        calls(executor, 1)
    assert calls(executor, 2) == [box]
    box.put()
    assert calls(executor, 2) == [box]

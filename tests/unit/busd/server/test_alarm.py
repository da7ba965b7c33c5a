"""busd.server.alarm: it wakes the core when a timer is due, and later if this process stood still."""

import asyncio
from collections.abc import Iterator

import pytest

from busd.core.timers import NEVER_NS, Timers
from busd.server import alarm as alarm_module
from busd.server.alarm import Alarm

SECOND = 1_000_000_000
GRACE_NS = 50_000_000


class Handle:
    def __init__(self, world: "World", delay_s: float) -> None:
        self.delay_s = delay_s
        self._world = world

    def cancel(self) -> None:
        self._world.calls.pop(self, None)


class World:
    """A clock and an event loop that stand still until `wait`."""

    def __init__(self) -> None:
        self.now_ns = 100 * SECOND
        self.calls: dict[Handle, object] = {}
        self.timers = Timers()
        self.woken = list[int]()

    def call_later(self, delay_s: float, action: object) -> Handle:
        handle = Handle(self, delay_s)
        self.calls[handle] = action
        return handle

    def delays(self) -> list[float]:
        return [handle.delay_s for handle in self.calls]

    def wake(self, now_ns: int) -> None:
        self.woken.append(now_ns)
        for action in self.timers.due(now_ns):
            action(now_ns)

    def wait(self, seconds: float) -> None:
        """Let the time pass. Then the loop makes its only call."""
        self.now_ns += int(seconds * SECOND)
        ((handle, action),) = self.calls.items()
        del self.calls[handle]
        action()  # type: ignore[operator]

    def add(self, seconds: float) -> None:
        self.timers.add(self.now_ns + int(seconds * SECOND), lambda now_ns: None)


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    world = World()
    monkeypatch.setattr(alarm_module, "monotonic_ns", lambda: world.now_ns)
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: world)
    yield world


def test_the_earliest_timer_sets_it(world: World) -> None:
    alarm = Alarm(world.timers, world.wake)
    alarm.set()
    assert (world.delays(), alarm.due_ns) == ([], NEVER_NS)
    for seconds, earliest in ((3, 3), (5, 3), (2, 2)):
        world.add(seconds)
        alarm.set()
        assert world.delays() == [earliest]
        assert alarm.due_ns == world.now_ns + earliest * SECOND


def test_it_is_set_again_for_the_next_timer(world: World) -> None:
    alarm = Alarm(world.timers, world.wake)
    world.add(1)
    world.add(3)
    alarm.set()
    world.wait(1)
    assert world.woken == [world.now_ns]
    assert world.delays() == [2]
    world.wait(2)
    assert (world.delays(), alarm.due_ns) == ([], NEVER_NS)


def test_what_is_due_already_comes_at_once(world: World) -> None:
    world.add(1)
    world.now_ns += 2 * SECOND
    alarm = Alarm(world.timers, world.wake)
    alarm.set()
    assert world.delays() == [0]
    world.wait(0)
    assert world.woken == [world.now_ns]


def test_grace_is_given_once_for_each_timer(world: World) -> None:
    """Leases must also end on a machine that is always late."""
    alarm = Alarm(world.timers, world.wake)
    for _ in range(2):
        world.woken.clear()
        world.add(1)
        alarm.set()
        world.wait(3)
        assert world.woken == []
        assert world.delays() == [GRACE_NS / SECOND]
        world.wait(3)
        assert world.woken == [world.now_ns]


@pytest.mark.parametrize(("late_s", "is_late"), [(0.25, False), (0.251, True)])
def test_a_quarter_of_a_second_is_late(late_s: float, is_late: bool, world: World) -> None:
    alarm = Alarm(world.timers, world.wake)
    world.add(1)
    alarm.set()
    world.wait(1 + late_s)
    assert bool(world.woken) is not is_late


def test_a_closed_one_wakes_nobody(world: World) -> None:
    alarm = Alarm(world.timers, world.wake)
    world.add(1)
    alarm.set()
    alarm.close()
    assert world.calls == {}
    world.add(0)
    alarm.set()
    assert world.calls == {}


def test_it_may_be_closed_by_what_it_wakes(world: World) -> None:
    def wake(now_ns: int) -> None:
        world.wake(now_ns)
        alarm.close()

    alarm = Alarm(world.timers, wake)
    world.add(1)
    world.add(2)
    alarm.set()
    world.wait(1)
    assert world.woken and world.calls == {}

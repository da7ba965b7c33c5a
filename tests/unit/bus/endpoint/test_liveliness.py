"""bus.endpoint.liveliness: every event in every state, and the numbers that are told."""

import asyncio
from collections.abc import Callable
from typing import cast

import pytest

from bus.endpoint.liveliness import TRANSITIONS, LivelinessWatch, Sign, Standing
from bus.events import LivelinessChanged
from transitions import paths

OWN_NS, LONGER_NS = 1_000_000_000, 3_000_000_000
COUNTED = {Standing.ALIVE: (1, 0), Standing.OVERDUE: (1, 0), Standing.NOT_ALIVE: (0, 1)}
PATHS = paths(TRANSITIONS, Standing.GONE)


class Timer:
    def __init__(self, delay_s: float, call: Callable[[], object]) -> None:
        self.delay_s = delay_s
        self.call = call
        self.is_cancelled = False

    def cancel(self) -> None:
        self.is_cancelled = True


class World:
    """A watch of a subscription, and its timers."""

    def __init__(self) -> None:
        self.told: list[LivelinessChanged] = []
        self.timers: list[Timer] = []
        self.watch = LivelinessWatch(self, LONGER_NS, self.told.append)

    def later(self, delay_s: float, call: Callable[[], object]) -> asyncio.TimerHandle:
        self.timers.append(Timer(delay_s, call))
        return cast("asyncio.TimerHandle", self.timers[-1])

    def give(self, sign: Sign, publisher: int = 1) -> None:
        match sign:
            case Sign.MATCH | Sign.MATCH_UNPROVEN:
                self.watch.match(publisher, is_proven=sign is Sign.MATCH)
            case Sign.LIFE:
                self.watch.life(publisher)
            case Sign.LAPSE:
                self.watch.lapse(publisher, LONGER_NS)
            case Sign.LAPSE_EARLY:
                self.watch.lapse(publisher, OWN_NS)
            case Sign.END:
                for timer in self.running():
                    timer.is_cancelled = True
                    timer.call()
            case Sign.UNMATCH:
                self.watch.unmatch(publisher)

    def running(self) -> list[Timer]:
        return [timer for timer in self.timers if not timer.is_cancelled]


def test_all_states_can_be_reached() -> None:
    assert set(PATHS) == set(Standing)


@pytest.mark.parametrize("state", Standing, ids=lambda one: one.value)
@pytest.mark.parametrize("sign", Sign, ids=lambda one: one.value)
def test_each_event_in_each_state(state: Standing, sign: Sign) -> None:
    world = World()
    for one in PATHS[state]:
        world.give(one)
    world.told.clear()
    world.give(sign)
    after = TRANSITIONS[state].get(sign, state)
    (was_alive, was_not), (is_alive, is_not) = COUNTED.get(state, (0, 0)), COUNTED.get(after, (0, 0))
    change = (is_alive - was_alive, is_not - was_not)
    assert world.told == ([LivelinessChanged(is_alive, is_not, *change)] if any(change) else [])
    assert len(world.running()) == (after is Standing.OVERDUE), "the rest of a lease runs in this state only"
    world.give(Sign.UNMATCH)
    assert sum(one.alive_count_change for one in world.told) == -was_alive
    assert sum(one.not_alive_count_change for one in world.told) == -was_not


def test_the_rest_of_the_longer_lease_is_waited_for() -> None:
    world = World()
    world.give(Sign.MATCH)
    world.give(Sign.LAPSE_EARLY)
    assert [timer.delay_s for timer in world.timers] == [2.0]


def test_numbers_of_several_publishers() -> None:
    world = World()
    for publisher in (1, 2, 3):
        world.give(Sign.MATCH, publisher)
    world.give(Sign.LAPSE, 2)
    world.give(Sign.UNMATCH, 1)
    assert world.told[-2:] == [LivelinessChanged(2, 1, -1, 1), LivelinessChanged(1, 1, -1, 0)]


def test_its_end_cancels_its_timers() -> None:
    world = World()
    world.give(Sign.MATCH)
    world.give(Sign.LAPSE_EARLY)
    world.watch.end()
    assert world.running() == []

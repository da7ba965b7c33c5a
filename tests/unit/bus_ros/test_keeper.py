"""bus_ros.keeper: the times of its turns, and its end."""

from collections.abc import Iterator
from threading import Event, RLock, get_ident

import pytest

from bus_ros import keeper as keepers
from bus_ros.keeper import Keeper, KeeperState
from conftest import WAIT_S
from neighbours import wait_until

LONG_S = 3600.0


class Kept:
    """A keeper that may sleep or not, and the urgency of each turn."""

    def __init__(self) -> None:
        self.guard = RLock()
        self.keeper = Keeper(self.guard, self._turn)  # type: ignore[arg-type]  # an RLock returns a bool
        self.turns: list[bool] = []
        self.may_sleep = False
        self.has_begun = Event()

    def _turn(self, is_urgent: bool) -> bool:
        self.turns.append(is_urgent)
        self.thread = get_ident()
        self.has_begun.set()
        return self.may_sleep

    def start(self) -> None:
        self.keeper.start()
        assert self.has_begun.wait(WAIT_S)

    def close(self) -> None:
        with self.guard:
            self.keeper.close()
        self.keeper.join()


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[Kept]:
    monkeypatch.setattr(keepers, "_TICK_S", LONG_S)
    kept = Kept()
    yield kept
    kept.close()
    assert kept.keeper.state is KeeperState.CLOSED


def test_its_first_turn_is_urgent_and_in_a_thread_of_its_own(kept: Kept) -> None:
    kept.start()
    assert kept.turns == [True]
    assert kept.thread != get_ident()


def test_it_takes_a_turn_at_each_tick(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keepers, "_TICK_S", 0.001)
    kept.start()
    wait_until(lambda: len(kept.turns) > 3)
    assert kept.turns[:4] == [True, False, False, False]


def test_a_nudge_makes_a_turn_urgent(kept: Kept) -> None:
    kept.start()
    with kept.guard:
        kept.keeper.nudge()
        kept.keeper.nudge()  # this makes no further turn
    wait_until(lambda: len(kept.turns) == 2)
    assert kept.turns == [True, True]


def test_it_sleeps_without_ticks_until_it_is_woken(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keepers, "_TICK_S", 0.0)
    kept.may_sleep = True
    kept.start()
    wait_until(lambda: kept.keeper.state is KeeperState.ASLEEP)
    assert kept.turns == [True]
    with kept.guard:
        kept.keeper.wake()
        assert kept.keeper.state is KeeperState.TICKING
    wait_until(lambda: len(kept.turns) == 2)
    assert kept.turns == [True, False]
    wait_until(lambda: kept.keeper.state is KeeperState.ASLEEP)


def test_a_nudge_ends_its_sleep(kept: Kept) -> None:
    kept.may_sleep = True
    kept.start()
    wait_until(lambda: kept.keeper.state is KeeperState.ASLEEP)
    kept.keeper.nudge()
    wait_until(lambda: len(kept.turns) == 2)
    assert kept.turns == [True, True]


@pytest.mark.parametrize("may_sleep", [False, True])
def test_it_ends_whatever_it_waits_for(kept: Kept, may_sleep: bool) -> None:
    kept.may_sleep = may_sleep
    kept.start()
    kept.close()
    assert kept.turns == [True]

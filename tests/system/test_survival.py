"""Processes under load are killed and stopped at random moments: the others continue, nothing is left.

BUSD_SURVIVAL_ROUNDS makes it longer, BUSD_SURVIVAL_SEED repeats one run's choices.
"""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from conftest import WAIT_S, Daemon
from effort import examples
from neighbours import wait_until, with_limits
from nursery import Actor, Nursery, cpu_ticks, holdings, private_bytes, settle, until_alone, until_equal
from survivors import Ear

ROUNDS = int(os.environ.get("BUSD_SURVIVAL_ROUNDS", "0")) or examples(20)
VICTIMS = 4
MESSAGES = 800
"""The most messages of one victim."""
DEPTH = VICTIMS * MESSAGES
"""Room for all messages of the victims of one round."""
MOST_GROWTH_BYTES = 32 << 20
READERS = "/memfd:busd-readers (deleted)"
"""A process's readers' segment, as /proc shows it."""
ENDLESS = 1 << 40
"""More messages than any test sends."""

by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)


@pytest.fixture
def chance() -> random.Random:
    seed = int(os.environ.get("BUSD_SURVIVAL_SEED", "0")) or time.time_ns()
    print(f"BUSD_SURVIVAL_SEED={seed}")
    return random.Random(seed)


@pytest.fixture
def nursery(route: str, daemon: Daemon, tmp_path: Path, chance: random.Random) -> Iterator[Nursery]:
    with Nursery(tmp_path, chance) as nursery:
        yield nursery


@pytest.fixture
def promise(route: str) -> dict[str, str]:
    """Point at which a message is certain: the ring keeps it at once, a socket after it has taken it."""
    return {"notes": "publish" if route == "shm" else "flush"}


@pytest.fixture
def moment(chance: random.Random) -> Callable[..., None]:
    """Waits for a random time, so that the next action happens at any moment."""

    def moment(longest_s: float = 0.02) -> None:
        time.sleep(chance.uniform(0, longest_s))

    return moment


class Footprint:
    """Descriptors, mappings and memory of processes; a moment later they must have no more."""

    def __init__(self, *processes: Daemon | Actor) -> None:
        self._pids = [process.pid for process in processes]
        self._holdings = self._look()
        self._memory = list(map(private_bytes, self._pids))

    def assert_is_all(self) -> None:
        until_equal([Counter()] * len(self._pids), self._look_beyond)
        for pid, before in zip(self._pids, self._memory, strict=True):
            grown = private_bytes(pid) - before
            assert grown < MOST_GROWTH_BYTES, f"{pid} has grown by {grown >> 20} MiB"

    def _look(self) -> list[Counter[str]]:
        return list(map(holdings, self._pids))

    def _look_beyond(self) -> list[Counter[str]]:
        return [now - before for now, before in zip(self._look(), self._holdings, strict=True)]


class TestPublishers:
    def test_what_the_killed_have_published_arrives(
        self,
        daemon: Daemon,
        nursery: Nursery,
        route: str,
        promise: dict[str, Any],
        chance: random.Random,
        moment: Callable[..., None],
    ) -> None:
        shared = set(os.listdir("/dev/shm"))  # noqa: PTH208
        listeners = [nursery.listener(Ear(), Ear(DEPTH, calls_back=False)).ready() for _ in range(2)]
        footprint = None
        heard = 0
        for _ in range(ROUNDS):
            depths = chance.choices((0, DEPTH), k=VICTIMS)
            victims = [nursery.talker(depth=depth, goal=MESSAGES, **promise) for depth in depths]
            if chance.random() < 0.8:  # otherwise while they start
                for victim in victims:
                    victim.ready()
                assert listeners[0].ask("graph")["routes"] == [route]
            for victim in chance.sample(victims, VICTIMS):
                moment()
                victim.kill()
            for listener in listeners:
                for victim in victims:
                    listener.hears(victim)
            nursery.look()
            until_alone(*listeners)
            heard += sum(victim.said for victim in victims)
            footprint = footprint or Footprint(daemon, *listeners)
        assert heard > ROUNDS
        assert footprint is not None
        footprint.assert_is_all()
        assert not [name for name in set(os.listdir("/dev/shm")) - shared if "bus" in name]  # noqa: PTH208

    @by_shared_memory
    def test_of_the_killed_no_ring_is_left_anywhere(self, daemon: Daemon, nursery: Nursery) -> None:
        listener = nursery.listener(Ear()).ready()
        alone = Footprint(daemon, listener)
        of_daemon = holdings(daemon.pid)
        victims = [nursery.talker().ready() for _ in range(VICTIMS)]
        for victim in victims:
            listener.hears(victim, 1)
        until_equal(VICTIMS, lambda: holdings(listener.pid)["mapped /memfd:busd-ring (deleted)"])
        for victim in victims:
            victim.kill()
        alone.assert_is_all()
        listener.leave()
        of_listener = Counter({"open socket": 1, "open anon_inode:[eventfd]": 1, f"open {READERS}": 1})
        of_listener["open anon_inode:[eventpoll]"] = 1  # the last connection ends the watch for hang-ups
        until_equal(of_daemon - of_listener, lambda: holdings(daemon.pid))

    def test_a_stopped_one_is_waited_for_in_peace(
        self, daemon: Daemon, nursery: Nursery, promise: dict[str, Any], moment: Callable[..., None]
    ) -> None:
        listeners = [nursery.listener(Ear(), Ear(DEPTH, gaps="any")).ready() for _ in range(2)]
        talker = nursery.talker(**promise).ready()
        settle(*listeners, talker)  # if stopped earlier, it would not know how to wake them
        idle = [daemon.pid, *(listener.pid for listener in listeners)]
        for _ in range(ROUNDS // 4):
            moment()
            talker.stop()
            for listener in listeners:
                listener.hears(talker)
                listener.ask("accounts")
            before_s, before = time.monotonic(), list(map(cpu_ticks, idle))
            moment(0.3)
            passed_s = time.monotonic() - before_s
            for pid, ticks in zip(idle, before, strict=True):
                assert (cpu_ticks(pid) - ticks) / 100 < 0.03 + passed_s / 2, "it does not rest"
            talker.resume()
            for listener in listeners:
                listener.hears(talker, MESSAGES)
        total = talker.ask("stop")
        for listener in listeners:
            listener.has_heard_all((talker, total))


class TestSubscriptions:
    def test_the_killed_hold_up_nobody(
        self,
        daemon: Daemon,
        nursery: Nursery,
        chance: random.Random,
        moment: Callable[..., None],
    ) -> None:
        listener = nursery.listener(
            Ear(holds=5, views=True), Ear(DEPTH, gaps="any", calls_back=False)
        ).ready()
        talkers = [
            nursery.talker(size=size, burst=5, depth=depth, is_certain=not depth).ready()
            for size, depth in ((10_000, 0), (400, 50))
        ]
        footprint = None
        for _ in range(ROUNDS):
            victims = [nursery.listener(any_ear(chance), any_ear(chance)) for _ in range(VICTIMS)]
            if chance.random() < 0.8:  # otherwise while they start
                for victim in victims:
                    victim.ready()
            for victim in chance.sample(victims, VICTIMS):
                moment()
                victim.kill()
            for talker in talkers:
                talker.goes_on(100)
                listener.hears(talker)
            until_alone(listener, *talkers)
            nursery.look()
            footprint = footprint or Footprint(daemon, listener, *talkers)
        assert footprint is not None
        footprint.assert_is_all()
        listener.has_heard_all(*[(talker, talker.ask("stop")) for talker in talkers])

    def test_a_publisher_that_waits_for_one_is_released(
        self, nursery: Nursery, moment: Callable[..., None]
    ) -> None:
        listener = nursery.listener(Ear()).ready()
        talker = nursery.talker(size=100_000).ready()
        for _ in range(ROUNDS // 4):
            victims = [nursery.listener(stuck_ear()).ready() for _ in range(2)]
            wait_until(lambda: talker.waits and listener.heard(talker) >= talker.said)
            for victim in victims:
                moment()
                victim.kill()
            talker.goes_on(200)  # the window has room for some 80
            listener.hears(talker)
            nursery.look()

    @with_limits(lease_s=2)
    def test_a_publisher_that_waits_for_a_stopped_one_is_released(self, nursery: Nursery) -> None:
        """When the reader's lease ends. The reader wakes up in an overwritten ring; no message is torn."""
        listener = nursery.listener(Ear()).ready()
        stopped = nursery.listener(Ear(gaps="any", holds=5, views=True)).ready()
        talker = nursery.talker(size=100_000).ready()
        for _ in range(max(2, ROUNDS // 10)):  # each lasts a lease, longer than a busy machine stalls
            stopped.hears(talker, 10)
            stopped.stop()
            wait_until(lambda: talker.waits and listener.heard(talker) >= talker.said)
            talker.goes_on(200)
            assert listener.ask("graph")["nodes"].count(stopped.name) == 1, "it keeps its place"
            stopped.resume()
            stopped.hears(talker, 100)
            nursery.look()
        stopped.stop()
        wait_until(lambda: talker.waits and listener.heard(talker) >= talker.said)
        stopped.resume()
        stopped.has_heard_all((talker, talker.ask("stop")))

    def test_a_stopped_one_gets_the_newest(
        self, nursery: Nursery, route: str, moment: Callable[..., None]
    ) -> None:
        """No publisher waits for it meanwhile."""
        depth = 20
        awake = nursery.listener(Ear(DEPTH, gaps="any")).ready()
        stopped = nursery.listener(Ear(depth, gaps="any"), Ear(depth, gaps="any", calls_back=False)).ready()
        talker = nursery.talker(depth=2 * depth).ready()
        assert awake.ask("graph")["routes"] == [route]
        for _ in range(ROUNDS // 2):
            moment()
            stopped.stop()
            awake.hears(talker, MESSAGES)
            moment()
            stopped.resume()
            stopped.hears(talker)
        stopped.stop()
        talker.goes_on(MESSAGES)
        total = talker.ask("stop")
        awake.has_heard_all((talker, total))
        stopped.resume()
        stopped.has_heard_all((talker, total))
        for newest in stopped.ask("newest"):
            assert newest[-depth:] == list(range(total - depth + 1, total + 1))
        for _, queued, dropped in stopped.ask("accounts"):
            assert not queued
            assert dropped

    @by_shared_memory
    def test_a_ring_can_only_be_read(self, nursery: Nursery) -> None:
        listener = nursery.listener(Ear(), keeps_rings=True).ready()
        talker = nursery.talker(depth=50, is_certain=False).ready()
        listener.hears(talker, 1)
        assert {*map(tuple, listener.ask("rings"))} == {()}


class TestBroker:
    @by_shared_memory
    @with_limits(
        lease_s=WAIT_S
    )  # no publisher may go on without the stopped listeners, however busy the machine is
    def test_while_it_is_dead_messages_flow(
        self, daemon: Daemon, nursery: Nursery, moment: Callable[..., None], chance: random.Random
    ) -> None:
        listeners = [nursery.listener(Ear(), Ear(DEPTH, gaps="any")).ready() for _ in range(2)]
        talkers = [nursery.talker().ready(), nursery.talker(depth=50, is_certain=False).ready()]
        settle(*listeners, *talkers)
        for listener in listeners:
            listener.stop()
        talkers[1].goes_on(20 * MESSAGES)  # so its ring has grown already: that needs busd
        for listener in listeners:
            listener.resume()
        for listener, talker in product(listeners, talkers):
            listener.hears(talker, MESSAGES)
        footprint = Footprint(*listeners, *talkers)
        for _ in range(max(3, ROUNDS // 4)):
            if chance.random() < 0.7:  # otherwise while they declare themselves again
                until_alone(*listeners, *talkers)
            moment()
            daemon.kill()
            for listener, talker in product(listeners, talkers):
                listener.hears(talker, MESSAGES)
            daemon.restart()
            nursery.look()
        until_alone(*listeners, *talkers)
        assert listeners[0].ask("graph")["routes"] == ["shm"]
        footprint.assert_is_all()
        totals = [(talker, talker.ask("stop")) for talker in talkers]
        for listener in listeners:
            listener.has_heard_all(*totals)

    def test_streams_are_complete_all_the_same(self, daemon: Daemon, nursery: Nursery) -> None:
        """The publisher resends the messages that busd had received and not yet delivered."""
        listener = nursery.listener(Ear(), Ear(calls_back=False)).ready()
        talker = nursery.talker(burst=100, pause_s=0.0, size=1000).ready()
        for _ in range(3):
            listener.hears(talker, MESSAGES)
            daemon.kill()
            daemon.restart()
        listener.has_heard_all((talker, talker.ask("stop")))

    @by_shared_memory
    def test_while_it_is_dead_others_may_die(self, daemon: Daemon, nursery: Nursery) -> None:
        listener = nursery.listener(Ear()).ready()
        stuck = nursery.listener(stuck_ear()).ready()
        talker, victim = nursery.talker().ready(), nursery.talker().ready()
        settle(listener, stuck, talker, victim)
        daemon.kill()
        wait_until(lambda: talker.waits and victim.waits)
        stuck.kill()
        victim.kill()
        listener.hears(victim)
        listener.hears(talker, MESSAGES)
        daemon.restart()
        until_alone(listener, talker)
        listener.hears(talker, MESSAGES)

    @by_shared_memory
    def test_what_outgrows_a_ring_meanwhile_comes_afterwards(self, daemon: Daemon, nursery: Nursery) -> None:
        listeners = [nursery.listener(Ear(), Ear(views=True)).ready() for _ in range(2)]
        talker = nursery.talker(size=1_000_000, growth=2000, goal=MESSAGES, burst=1).ready()
        settle(*listeners, talker)
        daemon.kill()
        wait_until(lambda: talker.waits and max(one.heard(talker) for one in listeners) < talker.said)
        daemon.restart()
        until_equal(MESSAGES, lambda: talker.said)
        for listener in listeners:
            listener.has_heard_all((talker, MESSAGES))

    def test_a_stopped_one_loses_nothing(
        self, daemon: Daemon, nursery: Nursery, route: str, moment: Callable[..., None]
    ) -> None:
        listener = nursery.listener(Ear()).ready()
        talker = nursery.talker().ready()
        settle(listener, talker)
        for _ in range(ROUNDS // 2):
            moment()
            daemon.process.send_signal(signal.SIGSTOP)
            if route == "shm":
                listener.hears(talker, MESSAGES)
            moment()
            daemon.process.send_signal(signal.SIGCONT)
            listener.hears(talker, MESSAGES)
        listener.has_heard_all((talker, talker.ask("stop")))


class TestGrowth:
    @by_shared_memory
    def test_whoever_dies_order_holds(
        self, daemon: Daemon, nursery: Nursery, chance: random.Random, moment: Callable[..., None]
    ) -> None:
        listeners = [nursery.listener(Ear(views=True), Ear(100, gaps="any")).ready() for _ in range(2)]
        footprint = None
        for _ in range(ROUNDS // 2):
            talkers = [
                nursery.talker(
                    depth=depth, size=60_000, growth=chance.randrange(50, 1000), goal=MESSAGES, burst=5
                )
                for depth in (0, 100)
            ]
            victims: list[Actor] = [*talkers, *(nursery.listener(any_ear(chance)) for _ in range(2))]
            for talker in talkers:
                talker.ready()
            for victim in chance.sample(victims, len(victims)):
                moment(0.08)
                victim.kill()
            for listener in listeners:
                listener.hears_out(*talkers)
            nursery.look()
            until_alone(*listeners)
            footprint = footprint or Footprint(daemon, *listeners)
        assert footprint is not None
        footprint.assert_is_all()


def any_ear(chance: random.Random) -> Ear:
    """A subscription that starts late, and may be slow, get stuck or keep messages."""
    depth = chance.choice((0, 10, DEPTH))
    return Ear(
        depth,
        gaps="any" if depth else "before",
        takes=chance.choice((20, ENDLESS)),
        holds=chance.choice((0, 5, 100)),
        views=chance.random() < 0.5,
        calls_back=chance.random() < 0.5,
    )


def stuck_ear() -> Ear:
    """A keep-all subscription that soon takes no more messages."""
    return Ear(gaps="before", takes=5, calls_back=False)

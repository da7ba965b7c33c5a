"""The accounts of both routes, end to end, against a naive model: every delivery, every count, every reason.

A story is a sequence of actions of several processes:

- publishing bursts of any size, taking, refusing to share memory
- blocking (some without a sign of life), dying, losing the connection, with busd or without

After each action the test waits until no message is in transit. Then the received messages, the programs'
counters and the graph must agree with the model.

BUSD_ACCOUNTS_STORIES=5000 plays 5,000 stories, different ones in each run.
"""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import pytest
import uvloop
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from accounts_cuts import Cuts, pick
from accounts_world import World
from bus import shm
from bus.link import connecting
from bus.qos import QoSProfile
from busd.core import absent, drops
from conftest import TEST_S
from effort import examples

Step: TypeAlias = tuple[Any, ...]
Beginning: TypeAlias = tuple[list[bool], list[tuple[int, QoSProfile]], list[tuple[int, QoSProfile]]]

STORIES = int(os.environ.get("BUSD_ACCOUNTS_STORIES", "0"))

offers = st.builds(
    QoSProfile,
    depth=st.sampled_from([1, 2, 3, 5]),
    history=st.sampled_from(["keep_last", "keep_last", "keep_last", "keep_all"]),
    reliability=st.sampled_from(["reliable", "reliable", "reliable", "best_effort"]),
    durability=st.sampled_from(["transient_local", "transient_local", "volatile"]),
) | st.builds(QoSProfile, depth=st.sampled_from([2, 5]), lifespan=st.just(1e-9))
# Without keep all + best effort: if a ring has no room, it loses messages, and the model can't know how many.
requests = st.builds(
    QoSProfile,
    depth=st.sampled_from([1, 2, 3, 5]),
    reliability=st.sampled_from(["reliable", "best_effort", "best_effort"]),
    durability=st.sampled_from(["transient_local", "volatile"]),
) | st.builds(
    QoSProfile, history=st.just("keep_all"), durability=st.sampled_from(["transient_local", "volatile"])
)
indices = st.integers(0, 99)
numbers = st.integers(1, 8)
bursts = st.lists(st.tuples(indices, numbers), max_size=3)


def _step(name: str, *arguments: st.SearchStrategy[Any]) -> st.SearchStrategy[Step]:
    return st.tuples(st.just(name), *arguments)


publish = _step("publish", indices, numbers)
come = _step("come", indices, offers.filter(lambda one: not one.lifespan_ns))
happenings = st.lists(
    st.one_of(
        st.tuples(publish),
        st.tuples(publish),
        st.builds(lambda at, count: (("publish", at, count), ("leave", at)), indices, numbers),
        st.builds(lambda at, count: (("publish", at, count), ("die", at)), indices, numbers),
        st.tuples(come, publish),
    ),
    max_size=4,
).map(lambda some: [one for group in some for one in group])
take = _step("take", indices, st.sampled_from([1, 2, 100, 100]))


def _cut(victims: st.SearchStrategy[int]) -> st.SearchStrategy[Step]:
    how = st.sampled_from(["hang up", "cut off", "stand still", "stand still"])
    return _step("cut", victims, how, happenings, happenings, st.none() | happenings)


steps = st.one_of(
    publish,
    publish,
    publish,
    take,
    take,
    _cut(indices),
    _step("publish_large", indices, st.integers(1, 3)),
    _step("block", indices, st.booleans()),
    _step("create_publisher", indices, offers),
    _step("create_subscription", indices, requests),
    _step("close", indices),
    _step("die", indices),
    _step("refuse", indices, st.booleans(), st.just([]) | bursts),
    _step("restart", bursts),
)
beginnings = st.tuples(
    st.lists(st.booleans(), min_size=2, max_size=3),
    st.lists(st.tuples(indices, offers), min_size=1, max_size=2),
    st.lists(st.tuples(indices, requests), min_size=2, max_size=3),
)
stories = st.lists(steps, min_size=8, max_size=20)
# One process with only subscriptions is cut off repeatedly; the publishers belong to the others.
beginnings_of_cuts = st.tuples(
    st.lists(st.booleans(), min_size=3, max_size=3),
    st.lists(st.tuples(st.integers(1, 2), offers), min_size=1, max_size=3),
    st.lists(st.tuples(st.just(0), requests), min_size=1, max_size=2),
)
stories_of_cuts = st.lists(
    st.one_of(publish, take, _step("block", st.just(0), st.booleans()), _cut(st.just(0)), _cut(st.just(0))),
    min_size=2,
    max_size=6,
)


class Story:
    """The actions; each picks its victim among the existing endpoints or processes."""

    def __init__(self, folder: Path, route: str, beginning: Beginning) -> None:
        shares, self.offers, self.requests = beginning
        self.world = World(folder, [route == "shm" and (one or not at) for at, one in enumerate(shares)])
        self.cuts = Cuts(self.world)
        self.has_rerouted = False

    async def play(self, story: list[Step]) -> None:
        world = self.world
        await world.open()
        try:
            for at, offer in self.offers:
                await self.create_publisher(at, offer)
            for at, request in self.requests:
                await self.create_subscription(at, request)
            await world.check()
            for name, *arguments in story:
                act: Callable[..., Any] = getattr(self, name)
                await act(*arguments)
                await world.check()
        finally:
            await world.close()

    async def create_publisher(self, at: int, qos: QoSProfile) -> None:
        await self.world.unblock_all()
        await self.world.create_publisher(pick(self.world.processes, at), qos)

    async def create_subscription(self, at: int, qos: QoSProfile) -> None:
        await self.world.unblock_all()
        await self.world.create_subscription(pick(self.world.processes, at), qos)

    async def publish(self, at: int, count: int, size: int = 1) -> None:
        if self.world.publishers:
            publisher = pick(self.world.publishers, at)
            if self.world.model.publishers[publisher].qos.lifespan_ns:
                await self.world.unblock_all()  # expiry at busd depends on the division into runs
            messages = self.world.publish(publisher, count, size)
            self.world.model.deliver(self.world.model.publishers[publisher], messages)

    async def publish_large(self, at: int, count: int) -> None:
        await self.world.unblock_all()  # the ring grows for it, and busd tells the readers
        await self.publish(at, count, 20_000)

    async def take(self, at: int, count: int) -> None:
        if self.world.subscriptions:
            self.world.take(pick(self.world.subscriptions, at), count)

    async def block(self, at: int, is_silent: bool) -> None:
        process = pick(self.world.processes, at)
        if process in self.world.model.blocked:
            await self.world.unblock_all()
        else:
            self.world.block(process, is_silent=is_silent)

    async def close(self, at: int) -> None:
        await self.world.unblock_all()
        if endpoints := {**self.world.publishers, **self.world.subscriptions}:
            await self.world.close_endpoint(pick(endpoints, at))

    async def die(self, at: int) -> None:
        await self.world.unblock_all()
        await self.world.die(pick(self.world.processes, at))

    async def refuse(self, at: int, by_publisher: bool, bursts: list[tuple[int, int]]) -> None:
        """Refuse a route; `bursts` are published before the subscription's process knows."""
        await self.world.unblock_all()
        # Only without lifespan: once the match is back on the route shm, the ring still has samples that have
        # expired at busd.
        model = self.world.model
        shared = {
            (publisher, one.id): None
            for one in model.subscriptions.values()
            for publisher, route in one.routes.items()
            if route == "shm" and not model.publishers[publisher].qos.lifespan_ns
        }
        self.has_rerouted |= bool(shared)
        if shared and bursts:
            late = [one for one in self.named(bursts) if not model.publishers[one[0]].qos.lifespan_ns]
            await self.world.refuse_late(*pick(shared, at), late, by_publisher=by_publisher)
        elif shared:
            self.world.refuse(*pick(shared, at), by_publisher=by_publisher)

    async def cut(
        self, at: int, how: str, before: list[Step], meanwhile: list[Step], again: list[Step] | None
    ) -> None:
        if self.knows_where_matches_began():
            process = pick(self.world.processes, at)
            model = self.world.model
            # With a lifespan, see `publish`. A blocked process also does not learn that a match is back on
            # the ring.
            expires = any(one.qos.lifespan_ns for one in model.publishers.values())
            if expires or self.has_rerouted:
                await self.world.unblock_all()
            await self.cuts.cut([process], meanwhile, how=how, before=before, again=again)

    async def restart(self, bursts: list[tuple[int, int]]) -> None:
        if self.knows_where_matches_began():
            await self.world.unblock_all()
            before = [("publish", at, count) for at, count in bursts]
            await self.cuts.cut([*self.world.processes], before, how="restart")

    def knows_where_matches_began(self) -> bool:
        """False if a publisher has a ring, and a subscription by socket has had nothing from it yet.

        Such a subscription counts earlier samples, sent to others, as lost if its connection is lost.
        """
        return not any(any(one.before.values()) for one in self.world.model.subscriptions.values())

    def named(self, bursts: list[tuple[int, int]]) -> list[tuple[int, int]]:
        there = self.world.publishers
        return [(pick(there, at), count) for at, count in bursts] if there else []


@pytest.mark.parametrize(
    "make_loop", [asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"]
)
@pytest.mark.parametrize(
    ("beginnings", "stories"),
    [(beginnings, stories), (beginnings_of_cuts, stories_of_cuts)],
    ids=["everything", "cuts"],
)
def test_against_the_model(
    route: str,
    beginnings: st.SearchStrategy[Beginning],
    stories: st.SearchStrategy[list[Step]],
    make_loop: Callable[[], asyncio.AbstractEventLoop],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.setattr(connecting, "_RETRY_S", (0.0, 0.001))
    monkeypatch.setattr(drops, "DROP_REPORT_NS", 0)
    monkeypatch.setattr(absent, "RETURN_NS", 0)

    @settings(
        max_examples=STORIES or examples(40),
        derandomize=not STORIES,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(beginnings, stories)
    def play(beginning: Beginning, story: list[Step]) -> None:
        async def bounded(folder: Path) -> None:
            async with asyncio.timeout(TEST_S):
                await Story(folder, route, beginning).play(story)

        with TemporaryDirectory(prefix="busd-") as folder, asyncio.Runner(loop_factory=make_loop) as runner:
            runner.run(bounded(Path(folder)))

    play()


async def test_a_match_by_its_ring_is_lost_before_it_is_heard_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The subscription misses samples published by that ring: before, it received them by socket."""
    if not shm.is_available():
        pytest.skip(shm.why_not())
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.setattr(connecting, "_RETRY_S", (0.0, 0.001))
    beginning: Beginning = ([True, True], [(1, QoSProfile())], [(0, QoSProfile()), (1, QoSProfile())])
    again = [("publish", 0, 8), ("leave", 0)]
    async with asyncio.timeout(TEST_S):
        await Story(tmp_path, "shm", beginning).play(
            [("refuse", 0, False, []), ("cut", 0, "hang up", [], [], again)]
        )

"""bus.delivery.shm_sender against a plain check of all its matches: samples that a ring must keep."""

import asyncio
import os
from contextlib import suppress
from time import monotonic_ns
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import shm
from bus.delivery.match import GateState, MatchError
from bus.delivery.ring_size import FOR_EVER
from bus.delivery.shm_sender import ShmSender
from bus.link.shm_context import ShmContext
from bus.msg.std_msgs import Int32
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from effort import examples

pytestmark = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())

LOSSLESS = QoSProfile(history="keep_all")
PROFILES = [QoSProfile(depth=depth) for depth in (1, 3, 3, 7)] + [LOSSLESS]
GIDS = st.integers(0, 4)
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("expect"), GIDS, st.integers(0, len(PROFILES) - 1)),
        st.tuples(st.just("attach"), GIDS, st.integers(0, 3)),
        st.tuples(st.just("unmatched"), GIDS, st.booleans()),
        st.tuples(st.just("publish"), st.integers(1, 3), st.none()),
        st.tuples(st.just("disconnected"), st.none(), st.none()),
        st.tuples(st.just("look"), st.none(), st.none()),
    ),
    max_size=40,
)


class World:
    def __init__(self, qos: QoSProfile) -> None:
        self.loop = asyncio.get_running_loop()
        self.shm_context = ShmContext(lambda owners: None)
        port: Any = SimpleNamespace(
            is_shared=False,
            now_ns=monotonic_ns,
            later=self.loop.call_later,
            report=lambda _: None,
            is_quiet=lambda: True,
        )
        support = type_support(Int32)
        owner: Any = SimpleNamespace(qos=qos, support=support, topic_name="/t", id=0)
        self.route = ShmSender(port, self.shm_context, owner)

    def close(self) -> None:
        self.route.close()
        self.shm_context.close()

    def expect(self, gid: int, profile: int) -> None:
        writer = self.route.writer
        at_ns = writer.since(0)[-1][1] if writer.latest else 0  # the newest sample is for it
        qos = PROFILES[profile]
        matched = m.Matched(
            endpoint=1,
            other=gid + 2,
            node="/n",
            gid=bytes([gid]),
            qos=qos,
            route="shm",
            next_seq=1,
            at_ns=at_ns,
        )
        self.route.expect(matched)

    def attach(self, gid: int, slot: int) -> None:
        attached = m.Attached(
            publisher=1, subscription=gid + 2, slot=slot, process=1, pid=os.getpid(), descriptors=2
        )
        self.route.attach(bytes([gid]), attached, (self.shm_context.segment, self.shm_context.doorbell))

    def unmatched(self, gid: int, is_lost: bool) -> None:
        self.route.unmatched(bytes([gid]), is_lost=is_lost)

    def publish(self, number: int, nothing: None) -> None:
        for _ in range(number):
            self.route.put((b"x",), 0)

    def disconnected(self, *_: None) -> None:
        self.route.disconnected()

    def look(self, *_: None) -> None:
        self.route.gates.forget_left()

    def check(self) -> None:
        route, gates = self.route, list(self.route.gates.by_gid.values())
        expected = [gate for gate in gates if gate.state in (GateState.EXPECTED, GateState.UNSURE)]
        holds = [gate.hold for gate in expected if gate.is_lossless]
        if route.gates.is_lossless:
            holds.append(route.gates.known_seq + 1)
        assert route.writer.hold == min(holds, default=0)
        assert route.gates.expected == {
            gate.matched.other for gate in expected if gate.state is GateState.EXPECTED
        }
        if route.writer.keep != FOR_EVER:
            assert route.writer.keep == max(route.gates.depth, *(gate.depth for gate in gates), 1)


@given(ACTIONS, st.booleans())
@settings(max_examples=examples(150))
def test_what_is_held_is_what_the_matches_need(actions: list[tuple[Any, ...]], is_lossless: bool) -> None:
    async def run() -> None:
        world = World(LOSSLESS if is_lossless else QoSProfile(depth=2))
        try:
            for name, *arguments in actions:
                with suppress(MatchError):  # then the step had no effect
                    getattr(world, name)(*arguments)
                world.check()
        finally:
            world.close()

    asyncio.run(run())

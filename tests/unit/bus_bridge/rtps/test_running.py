"""Participants with sockets and timers, on loopback."""

import asyncio

import pytest

from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.reach import Reach
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.running import RunningParticipant
from conftest import WAIT_S
from ports import own_domain

DOMAIN = own_domain()
TOPIC, TYPE = "rq/sRequest", "T"


class News:
    """The far endpoints, and an event for each change."""

    def __init__(self) -> None:
        self.topics: list[str] = []
        self.participants: set[bytes] = set()
        self.changed = asyncio.Event()

    def participant_added(self, data: ParticipantData) -> None:
        assert data.prefix not in self.participants
        self.participants.add(data.prefix)

    def participant_removed(self, prefix: bytes) -> None:
        self.participants.remove(prefix)

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        self.topics.append(endpoint.topic)
        self.changed.set()

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        self.topics.remove(endpoint.topic)
        self.changed.set()

    def warn(self, text: str) -> None:
        raise AssertionError(text)

    async def wait_for(self, count: int) -> None:
        async with asyncio.timeout(WAIT_S):
            while len(self.topics) != count:
                self.changed.clear()
                await self.changed.wait()


async def test_two_on_loopback() -> None:
    news, others = News(), News()
    one = RunningParticipant(DOMAIN, news, lambda one: True)
    two = RunningParticipant(DOMAIN, others, lambda one: one.topic == TOPIC)
    got: asyncio.Queue[bytes | None] = asyncio.Queue()

    def deliver(arrived: Arrived) -> None:
        got.put_nowait(arrived.payload)

    reader = two.add_reader(TOPIC, TYPE, deliver)
    one.add_writer("rq/otherRequest", TYPE)
    writer = one.add_writer(TOPIC, TYPE)
    try:
        await news.wait_for(1)
        await others.wait_for(1)
        assert [found.guid for found in two.endpoints_of(TOPIC)] == [writer.guid]
        for payload in (b"hello", bytes(300_000)):
            assert one.write(writer, payload) > 0
            assert await asyncio.wait_for(got.get(), WAIT_S) == payload
        two.remove(reader)
        two.remove(reader)
        await news.wait_for(0)
        assert one.unsent == 0
    finally:
        one.close()
        await others.wait_for(0)
        two.close()
        two.close()


async def test_one_with_discovery_off_finds_nothing_and_is_not_found() -> None:
    alone, news, others = News(), News(), News()
    off = RunningParticipant(DOMAIN, alone, lambda one: True, reach=Reach(discovery="OFF"))
    one = RunningParticipant(DOMAIN, news, lambda one: True)
    two = RunningParticipant(DOMAIN, others, lambda one: True)
    try:
        for each in (off, one, two):
            each.add_writer(TOPIC, TYPE)
        await news.wait_for(1)  # the ports are called in order, and `off` has the first one
        await others.wait_for(1)
        assert (news.participants, others.participants) == ({two.prefix}, {one.prefix})
        assert not alone.participants
    finally:
        for each in (off, one, two):
            each.close()


async def test_an_error_does_not_end_the_timer(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = asyncio.get_running_loop()
    errors: list[BaseException | None] = []
    loop.set_exception_handler(lambda loop, context: errors.append(context.get("exception")))
    one = RunningParticipant(DOMAIN, News(), lambda one: True)
    act, acted = one.core.act, asyncio.Event()

    def fail(now_ns: int) -> None:
        monkeypatch.setattr(one.core, "act", succeed)
        raise ValueError("once")

    def succeed(now_ns: int) -> None:
        act(now_ns)
        acted.set()

    monkeypatch.setattr(one.core, "act", fail)
    try:
        await asyncio.wait_for(acted.wait(), WAIT_S)
        assert [str(error) for error in errors] == ["once"]
    finally:
        one.close()

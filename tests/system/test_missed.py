"""A subscription that has reconnected, and the report of a (fake) broker about the samples it has missed."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest

import bus
import bus.link.connecting
from bus.msg.std_msgs import Int32
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import REPLAY
from bus.wire.runs import data_head
from conftest import WAIT_S
from fake_broker import FakeBroker, FakeConnection
from feeding import frame_record

GID, OTHER = b"p" * 16, b"q" * 16
DEEP = QoSProfile(depth=100)
LATCHED = QoSProfile(depth=3, durability="transient_local")


class Talk:
    """A subscription and its current connection."""

    client: FakeConnection
    subscription: bus.Subscription[Int32]

    def __init__(self, broker: FakeBroker, qos: QoSProfile) -> None:
        self._broker = broker
        self._qos = qos
        self._node = bus.Node("node", arguments=[], rosout=False)

    async def __aenter__(self) -> Self:
        opening = asyncio.ensure_future(self._node.open())
        self.client = await self._broker.accept()
        await self.client.create(m.CreateNode, 1)
        await opening
        creating = asyncio.ensure_future(self._node.create_subscription(Int32, "t", self._qos))
        await self.client.create(m.CreateSubscription, 2)
        self.subscription = await creating
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._node.close()

    async def come_back(self) -> dict[bytes, int]:
        """Reconnects; returns the last number of each publisher that the subscription reports."""
        await self.client.close()
        self.client = await self._broker.accept()
        await self.client.create(m.CreateNode, 1)
        request = await self.client.create(m.CreateSubscription, 2)
        heard: dict[bytes, int] = request.last_seqs
        return heard

    def match(self, other: int, gid: bytes, next_seq: int) -> None:
        matched = m.Matched(endpoint=2, other=other, node="/n", gid=gid, qos=self._qos, next_seq=next_seq)
        self.client.send(matched)

    def send(self, other: int, first_seq: int, count: int, *, is_replay: bool = False) -> None:
        body = b"".join(
            frame_record(b"\x91" + bytes([seq]), 0) for seq in range(first_seq, first_seq + count)
        )
        flags = REPLAY if is_replay else 0
        self.client.write(data_head(2, first_seq, count, len(body), only_for=other, flags=flags) + body)

    def tell(self, missed: dict[bytes, tuple[int, int]], **before: int) -> None:
        self.client.send(m.Dropped(subscription=2, dropped={}, missed=missed, before=before))

    async def totals(self) -> tuple[int, int, dict[str, int]]:
        """The totals of expected, queued and lost samples after all messages so far."""
        self.client.send(m.Ping(number=1))
        await self.client.expect(m.Pong)
        totals = self.subscription.statistics()
        return totals.expected, totals.queued, totals.dropped


@pytest.fixture
async def broker(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[FakeBroker]:
    monkeypatch.setattr(bus.link.connecting, "_RETRY_S", (0.0, 0.01))
    monkeypatch.setenv("BUS_ROUTE", "socket")
    async with asyncio.timeout(WAIT_S), FakeBroker(socket_path) as broker:
        yield broker


async def test_a_publisher_that_has_left(broker: FakeBroker) -> None:
    async with Talk(broker, DEEP) as talk:
        talk.match(7, GID, 1)
        talk.send(7, 1, 3)
        assert await talk.totals() == (3, 3, {})
        assert await talk.come_back() == {GID: 3}
        talk.tell({GID: (1, 9)})
        assert await talk.totals() == (9, 3, {"disconnected": 6})
        talk.tell({GID: (1, 9)})
        assert await talk.totals() == (9, 3, {"disconnected": 6}), "told twice, counted once"
        assert await talk.come_back() == {GID: 9}
        talk.match(8, GID, 12)  # it has returned, and has published
        talk.send(8, 12, 1)
        assert await talk.totals() == (12, 4, {"disconnected": 8})


async def test_a_publisher_of_which_it_never_heard(broker: FakeBroker) -> None:
    """Its samples were for the subscription from number 4 on; 9 is the last one before the match."""
    async with Talk(broker, DEEP) as talk:
        assert await talk.come_back() == {}
        talk.tell({GID: (4, 0), OTHER: (2, 3)})
        talk.match(7, GID, 10)
        assert await talk.totals() == (8, 0, {"disconnected": 8})
        report = await talk.client.expect(m.Report)
        assert (report.expected, report.dropped) == (8, {"disconnected": 8})
        talk.send(7, 10, 1)
        assert await talk.totals() == (9, 1, {"disconnected": 8})


async def test_why_it_was_dropped(broker: FakeBroker) -> None:
    """For samples not reported before, the broker's reasons count, from whichever publisher they come."""
    async with Talk(broker, DEEP) as talk:
        talk.match(7, GID, 1)
        talk.send(7, 1, 1)
        talk.client.send(m.Dropped(subscription=2, dropped={"replaced": 2}))
        assert await talk.totals() == (3, 1, {"replaced": 2})
        await talk.come_back()
        talk.tell({OTHER: (1, 1)}, replaced=4, expired=1)
        talk.match(8, GID, 9)
        assert await talk.totals() == (9, 1, {"replaced": 4, "expired": 1, "disconnected": 3})
        await talk.come_back()
        talk.tell({}, replaced=4, expired=1)
        talk.match(9, GID, 11)
        assert await talk.totals() == (11, 1, {"replaced": 4, "expired": 1, "disconnected": 5})


async def test_a_history_that_was_cut_short(broker: FakeBroker) -> None:
    """The subscription does not claim samples that have not arrived, so a broker sends them again."""
    async with Talk(broker, LATCHED) as talk:
        talk.match(7, GID, 10)
        assert await talk.totals() == (0, 0, {})
        assert await talk.come_back() == {}
        talk.match(7, GID, 10)
        talk.send(7, 7, 2, is_replay=True)
        assert await talk.totals() == (2, 2, {})
        assert await talk.come_back() == {GID: 8}
        talk.match(8, GID, 12)
        talk.send(8, 11, 1, is_replay=True)
        assert await talk.totals() == (5, 3, {"disconnected": 2})
        assert await talk.come_back() == {GID: 11}


async def test_a_publisher_that_has_published_nothing_yet(broker: FakeBroker) -> None:
    async with Talk(broker, LATCHED) as talk:
        talk.match(7, GID, 1)
        await talk.totals()
        assert await talk.come_back() == {GID: 0}

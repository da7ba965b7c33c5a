"""A client whose broker dies and returns at the worst moments; the fake broker makes that possible."""

import asyncio
import logging
import re
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

import bus
import bus.link.connecting
import bus.link.connection
import bus.link.requests
from bus.link.reach import Patience
from bus.msg.std_msgs import Int32
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.runs import Run
from conftest import WAIT_S
from fake_broker import FakeBroker, FakeConnection
from semantics import until


@pytest.fixture
async def broker(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[FakeBroker]:
    monkeypatch.setattr(bus.link.connecting, "_RETRY_S", (0.0, 0.01))
    monkeypatch.setenv("BUS_ROUTE", "socket")  # the broker does not see messages in rings
    async with asyncio.timeout(WAIT_S), FakeBroker(socket_path) as broker:
        yield broker


async def opened(broker: FakeBroker, name: str = "node", id: int = 1) -> tuple[bus.Node, FakeConnection]:
    node = bus.Node(name, arguments=[], rosout=False)
    opening = asyncio.ensure_future(node.open())
    client = await broker.accept()
    await client.create(m.CreateNode, id)
    await opening
    return node, client


class TestOpening:
    @pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
    async def test_something_else_listens(
        self, broker: FakeBroker, answer: bytes, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bus.link.connecting, "Patience", lambda: Patience(0.1))

        async def answer_all() -> None:
            while True:
                client = await broker.meet()
                client.write(answer)
                await client.close()

        answering = asyncio.ensure_future(answer_all())
        with pytest.raises(bus.BrokerUnavailable):
            await bus.Node("node", arguments=[]).open()
        answering.cancel()

    async def test_another_version(self, broker: FakeBroker) -> None:
        opening = asyncio.ensure_future(bus.Node("node", arguments=[]).open())
        client = await broker.meet()
        client.send(m.Hello(version=PROTOCOL_VERSION + 1))
        with pytest.raises(bus.BrokerUnavailable) as caught:
            await opening
        assert f"version {PROTOCOL_VERSION + 1} offered, this side speaks {PROTOCOL_VERSION}" in str(
            caught.value
        )

    async def test_a_refusal_in_words(self, broker: FakeBroker) -> None:
        for before in ([], [m.Hello(version=PROTOCOL_VERSION)]):
            opening = asyncio.ensure_future(bus.Node("node", arguments=[]).open())
            client = await broker.meet()
            client.send(*before, m.Fault(text="not today"))
            with pytest.raises(bus.BrokerUnavailable):
                await opening
            if before:
                assert "not today" in str(opening.exception())

    @pytest.mark.parametrize("greets", [False, True])
    async def test_one_that_does_not_answer(
        self, broker: FakeBroker, greets: bool, socket_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.1)
        opening = asyncio.ensure_future(bus.Node("node", arguments=[]).open())
        client = await broker.meet()
        if greets:
            client.send(m.Hello(version=PROTOCOL_VERSION))
        text = f"busd at {socket_path} does not answer: it has said nothing for 0.1 s"
        with pytest.raises(bus.BrokerUnavailable, match=f"^{re.escape(text)}$"):
            await opening

    async def test_given_up(self, broker: FakeBroker) -> None:
        opening = asyncio.ensure_future(bus.Node("node", arguments=[]).open())
        client = await broker.meet()
        await client.expect(m.Hello)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        assert await client.receive() is None

    async def test_two_nodes_share_one_that_fails(self, broker: FakeBroker) -> None:
        nodes = [bus.Node(name, arguments=[]) for name in ("one", "two")]
        openings = [asyncio.ensure_future(node.open()) for node in nodes]
        client = await broker.meet()
        client.send(m.Hello(version=PROTOCOL_VERSION), m.Fault(text="not today"))
        for error in await asyncio.gather(*openings, return_exceptions=True):
            assert isinstance(error, bus.BrokerUnavailable)
            assert "not today" in str(error)

    async def test_one_that_was_just_leaving(self, broker: FakeBroker) -> None:
        """A busd that exits because it is idle may have a last connection in its backlog."""
        node = bus.Node("node", arguments=[], rosout=False)
        opening = asyncio.ensure_future(node.open())
        leaving = await broker.meet()
        await leaving.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 1)
        await opening
        await node.close()

    async def test_one_that_has_no_place_now(self, broker: FakeBroker) -> None:
        node = bus.Node("node", arguments=[], rosout=False)
        opening = asyncio.ensure_future(node.open())
        for _ in range(3):
            client = await broker.accept()
            client.send(m.Fault(text="not now", again=True))
            await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 1)
        await opening
        await node.close()

    async def test_one_that_never_has_a_place(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bus.link.connecting, "Patience", lambda: Patience(0.05))

        async def turn_all_away() -> None:
            while True:
                client = await broker.meet()
                client.send(m.Hello(version=PROTOCOL_VERSION), m.Fault(text="not now", again=True))
                await client.close()

        turning = asyncio.ensure_future(turn_all_away())
        with pytest.raises(bus.BrokerUnavailable, match=r"refused this process: not now; tried for 0\.05 s"):
            await bus.Node("node", arguments=[]).open()
        turning.cancel()


class TestWaiting:
    """While a client waits for an answer, any received bytes show that the broker lives."""

    async def test_while_there_are_signs_of_life(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.5)
        node, client = await opened(broker)
        asking = asyncio.ensure_future(node.graph())
        request = await client.expect(m.GetGraph)
        answer = m.encode_frame(
            m.GraphSnapshot(request=request.request, revision=0, nodes=(), endpoints=(), matches=())
        )
        for at in range(0, len(answer) - 1, 4):  # a part of the answer is a sign of life too
            client.write(answer[at : min(at + 4, len(answer) - 1)])
            await asyncio.sleep(0.1)
        assert len(answer) // 4 * 0.1 > 2 * bus.link.requests.ANSWER_S
        client.write(answer[-1:])
        assert (await asking).nodes == ()
        await node.close()

    async def test_not_for_one_that_says_nothing(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Earlier messages do not count: the time runs from the question."""
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.2)
        node, client = await opened(broker)
        began_s = time.monotonic()
        with pytest.raises(TimeoutError, match=r"has said nothing for 0\.2 s"):
            await node.graph()
        assert time.monotonic() - began_s >= 0.2
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 2)
        await node.close()

    async def test_the_log_says_once_that_it_waits(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
    ) -> None:
        for module in ("bus.link.reach", "bus.link.requests"):
            monkeypatch.setattr(f"{module}.TELL_S", 0.1)
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.4)
        node, client = await opened(broker)
        for _ in range(2):
            with pytest.raises(TimeoutError):
                await node.graph()
        await node.close()
        await client.close()
        assert capfd.readouterr().err.count("has said nothing for 0.1 s; still waiting for its answer") == 1

    async def test_each_question_has_its_own_time(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.4)
        node, client = await opened(broker)

        async def wait() -> float:
            began_s = time.monotonic()
            with pytest.raises(TimeoutError):
                await node.graph()
            return time.monotonic() - began_s

        first = asyncio.ensure_future(wait())
        await asyncio.sleep(0.2)
        second = asyncio.ensure_future(wait())
        assert await first >= 0.4
        assert await second >= 0.4
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 2)
        await node.close()

    async def test_what_was_not_read_yet_counts(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """This process was delayed, not the broker."""
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.1)
        node, client = await opened(broker)
        asking = asyncio.ensure_future(node.graph())
        request = await client.expect(m.GetGraph)
        client.send(m.GraphSnapshot(request=request.request, revision=0, nodes=(), endpoints=(), matches=()))
        time.sleep(0.2)  # noqa: ASYNC251 - the loop's timers come before its sockets
        assert (await asking).nodes == ()
        await node.close()


class TestCreating:
    async def test_one_that_dies_before_it_answers(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        creating = asyncio.ensure_future(node.create_publisher(Int32, "t"))
        await client.expect(m.CreatePublisher)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        request = await client.create(m.CreatePublisher, 12)
        assert request.node == 11
        publisher = await creating
        assert publisher._core.id == 12
        publisher.publish(Int32(data=1))
        assert (await client.expect(Run)).endpoint == 12
        await node.close()

    @pytest.mark.parametrize("kind", [m.CreatePublisher, m.CreateSubscription])
    async def test_cancelled_before_the_answer(self, broker: FakeBroker, kind: Any) -> None:
        node, client = await opened(broker)
        make = node.create_publisher if kind is m.CreatePublisher else node.create_subscription
        creating = asyncio.ensure_future(make(Int32, "t"))
        request = await client.expect(kind)
        creating.cancel()
        await asyncio.gather(creating, return_exceptions=True)
        client.send(m.Created(request=request.request, id=7))
        assert (await client.expect(m.DestroyEndpoint)).endpoint == 7
        await self.reconnects_without_endpoints(broker, client)
        await node.close()

    @pytest.mark.parametrize("kind", [m.CreatePublisher, m.CreateSubscription])
    async def test_cancelled_as_the_answer_comes(
        self, broker: FakeBroker, kind: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The answer has been read, and its task would run next."""
        node, client = await opened(broker)
        make = node.create_publisher if kind is m.CreatePublisher else node.create_subscription
        creating = asyncio.ensure_future(make(Int32, "t"))
        request = await client.expect(kind)
        resolve = bus.link.connection.Connection.resolve

        def resolve_and_cancel(connection: bus.link.connection.Connection, message: Any) -> bool:
            result = resolve(connection, message)
            if isinstance(message, m.Created) and message.request == request.request:
                creating.cancel()
            return result

        monkeypatch.setattr(bus.link.connection.Connection, "resolve", resolve_and_cancel)
        client.send(m.Created(request=request.request, id=7))
        with pytest.raises(asyncio.CancelledError):
            await creating
        assert (await client.expect(m.DestroyEndpoint)).endpoint == 7
        await self.reconnects_without_endpoints(broker, client)
        await node.close()

    async def reconnects_without_endpoints(self, broker: FakeBroker, client: FakeConnection) -> None:
        """Endpoints that were not created are not declared to the next broker either."""
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 21)
        client.send(m.Ping())
        assert isinstance(await client.receive(), m.Pong)

    async def test_a_node_given_up_as_the_answer_comes(self, broker: FakeBroker) -> None:
        first, client = await opened(broker)
        second = bus.Node("second", arguments=[], rosout=False)
        opening = asyncio.ensure_future(second.open())
        request = await client.expect(m.CreateNode)
        opening.cancel()
        await asyncio.gather(opening, return_exceptions=True)
        client.send(m.Created(request=request.request, id=2))
        assert (await client.expect(m.DestroyNode)).node == 2
        await first.close()


class TestComingBack:
    async def test_a_node_says_whether_it_is_connected(self, broker: FakeBroker) -> None:
        assert not bus.Node("other", arguments=[]).is_connected
        node, client = await opened(broker)
        assert node.is_connected
        await client.close()
        await until(lambda: not node.is_connected)
        client = await broker.accept()
        await client.create(m.CreateNode, 2)
        await until(lambda: node.is_connected)
        await node.close()
        assert not node.is_connected

    async def test_a_node_closed_before_it_is_declared_again(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture
    ) -> None:
        """The new broker must not get its old id, which may belong to another node there."""
        staying, client = await opened(broker, "staying", 1)
        leaving = bus.Node("leaving", arguments=[], rosout=False)
        opening = asyncio.ensure_future(leaving.open())
        await client.create(m.CreateNode, 2)
        await opening
        await client.close()
        client = await broker.accept()
        request = await client.expect(m.CreateNode)
        await leaving.close()
        client.send(m.Created(request=request.request, id=11))
        second = await client.receive()
        if isinstance(second, m.CreateNode):  # already sent, so the node must be removed again
            client.send(m.Created(request=second.request, id=12))
            destroyed = await client.expect(m.DestroyNode)
            assert destroyed.node == 12
        client.send(m.Ping())
        assert isinstance(await client.receive(), m.Pong)
        await staying.close()
        assert (await client.expect(m.DestroyNode)).node == 11
        assert caplog.text.count("lost busd") == 1

    async def test_an_endpoint_closed_before_it_is_declared_again(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        creating = asyncio.ensure_future(node.create_publisher(Int32, "t"))
        await client.create(m.CreatePublisher, 2)
        publisher = await creating
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        request = await client.expect(m.CreatePublisher)
        await publisher.close()
        client.send(m.Created(request=request.request, id=12), m.Ping())
        assert (await client.expect(m.DestroyEndpoint)).endpoint == 12
        await client.expect(m.Pong)
        await node.close()

    async def test_a_node_closed_while_its_endpoints_are_declared_again(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        staying = bus.Node("staying", arguments=[], rosout=False)
        opening = asyncio.ensure_future(staying.open())
        await client.create(m.CreateNode, 2)
        await opening
        creating = asyncio.ensure_future(node.create_subscription(Int32, "t"))
        await client.create(m.CreateSubscription, 3)
        await creating
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        await client.create(m.CreateNode, 12)
        request = await client.expect(m.CreateSubscription)
        await node.close()
        client.send(m.Created(request=request.request, id=13), m.Ping())
        gone = []
        while not isinstance(message := await client.receive(), m.Pong):
            gone.append(message)
        assert m.DestroyNode(node=11) in gone
        await staying.close()

    async def test_lost_again_and_again(self, broker: FakeBroker, caplog: pytest.LogCaptureFixture) -> None:
        """At every step of the reconnection; for the user it is a single loss."""
        caplog.set_level(logging.INFO, "bus")
        node, client = await opened(broker)
        creating = asyncio.ensure_future(node.create_publisher(Int32, "t"))
        await client.create(m.CreatePublisher, 2)
        publisher = await creating
        await client.close()
        client = await broker.meet()
        await client.close()
        client = await broker.accept()
        await client.close()
        client = await broker.accept()
        await client.expect(m.CreateNode)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        await client.expect(m.CreatePublisher)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 21)
        await client.create(m.CreatePublisher, 22)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 31)
        await client.create(m.CreatePublisher, 32)
        await until(lambda: "busd is back" in caplog.text and publisher._core.id == 32)
        publisher.publish(Int32(data=1))
        assert (await client.expect(Run)).endpoint == 32
        await node.close()

    async def test_one_that_cuts_off_at_once_is_called_less_often(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Pauses(tuple[float, ...]):
            def __getitem__(self, at: Any) -> Any:
                taken.append(at)
                return super().__getitem__(at)

        taken: list[int] = []
        monkeypatch.setattr(bus.link.connecting, "_RETRY_S", Pauses((0.0, 0.001, 0.002)))
        node, client = await opened(broker)
        for lasted_ns in (0, 10**12, 10**12, 10**12, 0):
            monkeypatch.setattr(bus.link.connecting, "_LASTED_NS", lasted_ns)
            await client.close()
            client = await broker.accept()
            await client.create(m.CreateNode, 1)
            await until(lambda: node.is_connected)
        assert taken == [0, 1, 2, 2, 0]
        await node.close()

    async def test_a_broker_that_takes_its_time(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        """All are requested at once, the log shows progress, and it takes longer than one answer may."""
        caplog.set_level(logging.INFO, "bus")
        monkeypatch.setattr(bus.link.connecting, "_REPORT_S", 0.1)
        node, client = await opened(broker)
        for id in range(2, 12):
            creating = asyncio.ensure_future(node.create_subscription(Int32, "t"))
            await client.create(m.CreateSubscription, id)
            await creating
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.5)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 21)
        requests = [await client.expect(m.CreateSubscription) for _ in range(10)]
        for id, request in enumerate(requests, 22):
            await asyncio.sleep(0.1)
            client.send(m.Created(request=request.request, id=id))
        await until(lambda: "busd is back (pid" in caplog.text)
        told = re.findall(r"busd is back: (\d+) of 10 endpoints declared again", caplog.text)
        assert len(told) >= 3
        assert sorted(map(int, told)) == list(map(int, told))
        assert broker.connections == 2
        await node.close()

    async def test_nonsense_from_the_broker(self, broker: FakeBroker) -> None:
        """Messages about unknown or former objects are ignored."""
        node, client = await opened(broker)
        creating = asyncio.ensure_future(node.create_subscription(Int32, "t"))
        await client.create(m.CreateSubscription, 2)
        subscription = await creating
        client.send(
            m.Created(request=999, id=5),
            m.Done(request=999),
            m.Refused(request=999, text="no"),
            m.Unmatched(endpoint=2, other=77),
            m.Unmatched(endpoint=88, other=77),
            m.Credit(publisher=2, seq=1 << 40),
            m.LivelinessChanged(subscription=2, publisher=77, alive=False),
            m.LivelinessLost(publisher=2),
            m.Dropped(subscription=99, dropped={"replaced": 1}),
            m.GraphChanged(revision=7),
            m.Pong(number=9),
            m.Ping(number=3),
        )
        assert (await client.expect(m.Pong)).number == 3
        assert subscription.get_publisher_count() == 0
        await node.close()

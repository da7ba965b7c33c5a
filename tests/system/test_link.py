"""The link to the broker: declarations repeated or undone, and the limits of one failure."""

import asyncio
import logging
import os
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

import bus
import bus.link.connecting
import bus.link.graph_watch
from bus.link import declarations
from bus.link.connection import Connection
from bus.link.declarations import Declarations
from bus.msg.std_msgs import Int32
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.runs import Run
from conftest import WAIT_S
from fake_broker import FakeBroker, FakeConnection
from semantics import KEEP_ALL, node, until

pytestmark = pytest.mark.both_loops

__all__ = ["node"]

SILENT_S = 1e6
"""With so long a lease, no heartbeat can help a test to continue."""


@pytest.fixture
async def broker(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[FakeBroker]:
    monkeypatch.setattr(bus.link.connecting, "_RETRY_S", (0.0, 0.01))
    monkeypatch.setenv("BUS_ROUTE", "socket")  # the broker does not see messages in rings
    async with asyncio.timeout(WAIT_S), FakeBroker(socket_path) as broker:
        yield broker


async def opened(broker: FakeBroker) -> tuple[bus.Node, FakeConnection]:
    opening = asyncio.ensure_future(opened_too("node"))
    client = await broker.accept(lease_s=SILENT_S)
    await client.create(m.CreateNode, 1)
    return await opening, client


async def opened_too(name: str) -> bus.Node:
    node = bus.Node(name, arguments=[], rosout=False)
    await node.open()
    return node


async def with_publisher(
    node: bus.Node, client: FakeConnection, id: int, qos: bus.QoS = 10
) -> bus.Publisher[Int32]:
    creating = asyncio.ensure_future(node.create_publisher(Int32, "t", qos))
    await client.create(m.CreatePublisher, id)
    return await creating


def matched(endpoint: int) -> m.Matched:
    return m.Matched(
        endpoint=endpoint, other=99, gid=b"g" * 16, node="/other", qos=bus.QoSProfile(), next_seq=1
    )


class TestAnswers:
    async def test_of_another_kind(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        asking = asyncio.ensure_future(node.graph())
        client.send(m.Done(request=(await client.expect(m.GetGraph)).request))
        with pytest.raises(bus.BusError, match="busd sent Done instead of Graph"):
            await asking
        asking_again = asyncio.ensure_future(node.get_type("a", "b"))
        request = (await client.expect(m.GetType)).request
        client.send(m.Created(request=request, id=1, depth=1, max_message_bytes=1))
        with pytest.raises(bus.BusError, match="busd sent Created instead of TypeDescription"):
            await asking_again
        await node.close()


class TestTheGraph:
    async def test_changes_that_follow_each_other_are_looked_at_together(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The graph is large, so each new snapshot of it takes time."""
        monkeypatch.setattr(bus.link.graph_watch, "_LONGEST_REST_S", 0.1)
        monkeypatch.setattr(bus.link.graph_watch, "_REST", 1e9)
        node, client = await opened(broker)
        looked_s = []

        def is_there(graph: bus.Graph) -> bool:
            looked_s.append(time.monotonic())
            return bool(graph.nodes)

        waiting = asyncio.ensure_future(node.wait_for_graph(is_there))
        observe = await client.expect(m.Observe)
        client.send(m.GraphSnapshot(request=observe.request, revision=1, nodes=(), endpoints=(), matches=()))
        for revision in range(2, 32):
            client.send(m.GraphChanged(revision=revision))
            await asyncio.sleep(0.01)
        record = m.NodeRecord(id=1, name="there", namespace="/", pid=1)
        client.send(m.GraphChanged(revision=32, nodes_added=(record,)))
        assert [one.name for one in (await waiting).nodes] == ["there"]
        assert len(looked_s) > 2
        # On a busy machine, the loop's time may be old: then a single rest is shorter.
        assert len(looked_s) - 2 <= (looked_s[-1] - looked_s[0]) / 0.05
        off = await client.expect(m.Observe)
        assert not off.on
        await node.close()

    async def test_what_is_read_with_the_snapshot_counts(self, broker: FakeBroker) -> None:
        """The same read may hold changes before and after the snapshot."""
        node, client = await opened(broker)
        graphs = node.watch_graph()
        watching = asyncio.ensure_future(anext(graphs))
        observe = await client.expect(m.Observe)
        here, there, gone = (m.NodeRecord(id=one, name=f"n{one}", namespace="/", pid=1) for one in (1, 2, 3))
        client.send(
            m.GraphChanged(revision=7, nodes_removed=(1,)),  # of an earlier question
            m.GraphSnapshot(
                request=observe.request, revision=7, nodes=(here,), endpoints=(), matches=(), pid=5
            ),
            m.GraphChanged(revision=8, nodes_added=(there, gone)),
            m.GraphChanged(revision=9, nodes_removed=(3,)),
        )
        graph = await watching
        assert (graph.revision, graph.broker_pid) == (9, 5)
        assert [one.name for one in graph.nodes] == ["n1", "n2"]
        await graphs.aclose()
        await node.close()

    async def test_a_busd_that_contradicts_itself(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        graphs = node.watch_graph()
        watching = asyncio.ensure_future(anext(graphs))
        observe = await client.expect(m.Observe)
        endpoint = m.EndpointRecord(
            id=2,
            kind="publisher",
            node=9,
            topic="/t",
            type_name="",
            type_hash="",
            gid=b"",
            qos=bus.QoSProfile(),
        )
        client.send(
            m.GraphSnapshot(request=observe.request, revision=1, nodes=(), endpoints=(endpoint,), matches=())
        )
        with pytest.raises(bus.RemoteProtocolError, match="node 9, which is not in it"):
            await watching
        await node.close()


class TestDeclaringAgain:
    async def test_what_failed_halfway_is_undone(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """For example, one of many answers is late."""
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)
        declare_again, failures = Declarations.declare_again, [TimeoutError("too slow")]

        async def failing(declarations: Declarations, connection: Connection) -> None:
            await declare_again(declarations, connection)
            await until(lambda: publisher.get_subscription_count() == 1)
            if failures:
                raise failures.pop()

        monkeypatch.setattr(Declarations, "declare_again", failing)
        await client.close()
        for first_id in (11, 21):
            client = await broker.accept(lease_s=SILENT_S)
            await client.create(m.CreateNode, first_id)
            await client.create(m.CreatePublisher, first_id + 1)
            client.send(m.Matched(**{**_fields(matched(first_id + 1)), "other": first_id + 5}))
            if first_id == 11:
                await until(lambda: not failures)
                publisher.publish(Int32(data=1))
        assert (await client.expect(Run)).endpoint == 22
        assert publisher.get_subscription_count() == 1
        await node.close()

    async def test_a_node_that_the_new_broker_refuses(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture
    ) -> None:
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)
        opening = asyncio.ensure_future(opened_too("staying"))
        await client.create(m.CreateNode, 3)
        staying = await opening
        await client.close()
        client = await broker.accept()
        request = await client.expect(m.CreateNode)
        client.send(m.Refused(request=request.request, text="not that name"))
        await client.create(m.CreateNode, 13)
        assert (await with_publisher(staying, client, 14))._core.id == 14
        with pytest.raises(bus.ConfigurationError, match="not that name"):
            publisher.publish(Int32())
        with pytest.raises(bus.ConnectionClosed, match="/node"):
            await node.create_publisher(Int32, "t")
        assert caplog.text.count("refuses the node /node") == 1
        await node.close()
        client.send(m.Ping(number=5))
        while not isinstance(message := await client.receive(), m.Pong):
            assert not isinstance(message, m.DestroyNode)
        await staying.close()

    async def test_a_node_that_the_new_broker_has_no_room_for(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The client asks again, and meanwhile the node loses nothing."""
        monkeypatch.setattr(declarations, "AGAIN_S", 0.01)
        caplog.set_level(logging.INFO)
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)
        await client.close()
        client = await broker.accept()
        for _ in range(2):
            request = await client.expect(m.CreateNode)
            publisher.publish(Int32(data=7))
            client.send(m.Refused(request=request.request, text="", resource="nodes", used=1, limit=1))
        await until(lambda: "has no room" in caplog.text)
        with pytest.raises(bus.QuotaExceeded):
            await node.create_publisher(Int32, "t")
        await client.create(m.CreateNode, 11)
        await client.create(m.CreatePublisher, 12)
        assert (await client.expect(Run)).endpoint == 12
        assert caplog.text.count("busd has no room for the node /node") == 1
        await until(lambda: "busd has room for the node /node again" in caplog.text)
        await node.close()

    async def test_a_publisher_whose_gid_is_taken_at_the_new_broker(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Perhaps busd has not noticed the end of its earlier connection yet, so the client asks again."""
        monkeypatch.setattr(declarations, "AGAIN_S", 0.01)
        caplog.set_level(logging.INFO)
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        for _ in range(2):
            request = await client.expect(m.CreatePublisher)
            client.send(m.Refused(request=request.request, text="gid 00 is here", again=True))
        await client.create(m.CreatePublisher, 12)
        await until(lambda: publisher._core.id == 12)
        name = "the publisher on '/t'"
        assert caplog.text.count(f"busd has no room for {name}: gid 00 is here; asking again") == 1
        await node.close()

    async def test_one_that_closes_while_it_waits_for_room(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture
    ) -> None:
        caplog.set_level(logging.INFO)
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)
        staying = await with_publisher(node, client, 3)
        await client.close()
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        request = await client.expect(m.CreatePublisher)
        await client.create(m.CreatePublisher, 13)
        await publisher.close()
        client.send(m.Refused(request=request.request, text="", resource="endpoints", used=1, limit=1))
        await until(lambda: staying._core.id == 13 and "busd is back" in caplog.text)
        assert not node._link._declarations._waiting
        await node.close()

    async def test_the_log_tells_each_new_reason(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture
    ) -> None:
        node, client = await opened(broker)
        await client.close()
        for reason in ("not today", "not today", "not tomorrow"):
            client = await broker.meet()
            await client.expect(m.Hello)
            client.send(m.Hello(version=PROTOCOL_VERSION), m.Fault(text=reason))
        client = await broker.accept()
        await client.create(m.CreateNode, 11)
        await node.close()
        warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
        assert [text.rpartition(": ")[2] for text in warnings if "not back" in text] == [
            "not today",
            "not tomorrow",
        ]

    async def test_what_was_published_meanwhile_leaves_at_once(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2, KEEP_ALL)
        await client.close()
        client = await broker.accept(lease_s=SILENT_S)
        publisher.publish(Int32(data=1))
        flushing = asyncio.ensure_future(publisher.flush())
        await client.create(m.CreateNode, 11)
        await client.create(m.CreatePublisher, 12)
        assert (await client.expect(Run)).endpoint == 12
        await flushing
        await node.close()


class TestClosing:
    async def test_a_node_closed_while_its_endpoint_is_made(self, broker: FakeBroker) -> None:
        """The broker has removed the endpoint with its node, so the client sends nothing about it."""
        node, client = await opened(broker)
        opening = asyncio.ensure_future(opened_too("staying"))
        await client.create(m.CreateNode, 3)
        staying = await opening
        creating = asyncio.ensure_future(node.create_publisher(Int32, "t"))
        request = await client.expect(m.CreatePublisher)
        await node.close()
        client.send(m.Created(request=request.request, id=7), m.Ping(number=5))
        with pytest.raises(bus.ConnectionClosed, match="/node was closed"):
            await creating
        seen = []
        while not isinstance(message := await client.receive(), m.Pong):
            seen.append(message)
        assert seen == [m.DestroyNode(node=1)]
        await staying.close()

    @pytest.mark.parametrize("how", ["cancelled", "failing"])
    async def test_a_close_cut_short_leaves_the_graph(
        self, node: bus.Node, how: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        leaving = await opened_too("leaving")
        subscription = await leaving.create_subscription(Int32, "t")

        async def close() -> None:
            if how == "failing":
                raise RuntimeError("no")
            await asyncio.Event().wait()

        monkeypatch.setattr(subscription._core, "close", close)
        closing = asyncio.ensure_future(leaving.close())
        await asyncio.sleep(0)
        if how == "cancelled":
            closing.cancel()
        with pytest.raises(asyncio.CancelledError if how == "cancelled" else RuntimeError):
            await closing
        await node.wait_for_graph(lambda graph: [one.full_name for one in graph.nodes] == ["/tester"])
        with pytest.raises(bus.ConnectionClosed):
            await subscription.receive()

    async def test_an_observer_given_up_before_the_answer(self, broker: FakeBroker) -> None:
        node, client = await opened(broker)
        waiting = asyncio.ensure_future(node.wait_for_graph(lambda graph: True))
        assert (await client.expect(m.Observe)).on
        waiting.cancel()
        assert not (await client.expect(m.Observe)).on
        await node.close()


class TestReceiving:
    async def test_one_failure_does_not_take_the_rest_of_the_read_along(
        self, broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        told: list[Any] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: told.append(context))
        node, client = await opened(broker)
        publisher = await with_publisher(node, client, 2)

        def handle(message: Any, descriptors: Any) -> None:
            raise RuntimeError("a bug")

        monkeypatch.setattr(publisher._core, "handle", handle)
        client.send(matched(2), m.Ping(number=5))
        assert (await client.expect(m.Pong)).number == 5
        assert [repr(one["exception"]) for one in told] == ["RuntimeError('a bug')"]
        await node.close()


class TestSigns:
    async def test_counters_follow_what_is_taken(self, node: bus.Node) -> None:
        """No more messages arrive, and the queue drains."""
        publisher = await node.create_publisher(Int32, "t")
        subscription = await node.create_subscription(Int32, "t")
        for number in range(5):
            publisher.publish(Int32(data=number))

        async def queued() -> int:
            graph = await node.graph(statistics=True)
            [found] = [one for one in graph.subscriptions if one.topic == "/t"]
            return found.statistics.queued if found.statistics is not None else 0

        while await queued() != 5:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        while subscription.take():
            pass
        while await queued():  # noqa: ASYNC110
            await asyncio.sleep(0.01)

    async def test_the_heartbeat_follows_the_leases(
        self, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        beats: list[float] = []
        beat = Connection.beat

        def recorded(connection: Connection, interval_s: float) -> None:
            if beats[-1:] != [interval_s]:  # otherwise it repeats
                beats.append(interval_s)
            beat(connection, interval_s)

        monkeypatch.setattr(Connection, "beat", recorded)
        manual = bus.QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=0.003)
        await node.create_publisher(Int32, "manual", manual)
        await node.create_publisher(Int32, "none")
        await node.create_subscription(Int32, "t", bus.QoSProfile(liveliness_lease_duration=9.0))
        assert beats == []
        long = await node.create_publisher(Int32, "t", bus.QoSProfile(liveliness_lease_duration=0.3))
        short = await node.create_publisher(Int32, "t", bus.QoSProfile(liveliness_lease_duration=0.003))
        assert beats == [pytest.approx(0.1), 0.01]
        await short.close()
        await long.close()
        assert beats[2:] == [pytest.approx(0.1), pytest.approx(10 / 3)]


async def test_every_endpoint_of_a_forked_child_refuses(node: bus.Node) -> None:
    async def callback(message: Int32) -> None:
        pass

    async with bus.Node("other", arguments=[], rosout=False) as other:
        subscription = await node.create_subscription(Int32, "t", 10, callback)
        publishers = [await one.create_publisher(Int32, "t") for one in (node, other)]
        reader, writer = os.pipe()
        child = os.fork()
        if not child:
            try:
                for publisher in publishers:
                    try:
                        publisher.publish(Int32())
                    except bus.ForkError:
                        os.write(writer, b"refused ")
            finally:
                os._exit(0)
        os.close(writer)
        with os.fdopen(reader, "rb") as pipe:
            said = pipe.read()
        os.waitpid(child, 0)  # noqa: ASYNC222
        assert said == b"refused refused "
        publishers[1].publish(Int32())
        await until(lambda: subscription.statistics().delivered == 1)


def _fields(message: m.Matched) -> dict[str, Any]:
    return {name: getattr(message, name) for name in message.__struct_fields__}

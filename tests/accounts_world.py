"""A busd and several processes in one event loop, for `tests/property/test_accounts_model.py`.

Real sockets, real rings: the server, and for each "process" a node with its own connection. After each action
`World.settle` sends questions until no message is in transit. `check` compares every delivery and every
count, in the program and in the graph, with `accounts_model`.
"""

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic_ns

import msgspec

import accounts_model as model
import bus
from accounts_process import Process
from broker_world import whole_graph
from bus.base.time_namespace import monotonic_offset_ns
from bus.errors import ConnectionClosed
from bus.qos import QoSProfile
from bus.transport.stream_state import WriteState
from bus.wire import messages as m
from busd.core.broker import Broker
from busd.core.limits import Limits
from busd.server.listener import open_listener
from busd.server.peer import PeerConnection
from busd.server.server import Server
from conftest import WAIT_S

TOPIC = "/topic"


class Numbered(msgspec.Struct):
    publisher: int = 0
    number: int = 0
    padding: str = ""


class World:
    """`shares` says for each process whether it shares memory; `limits` are busd's; None: the defaults."""

    def __init__(self, folder: Path, shares: list[bool], limits: Limits | None = None) -> None:
        self.folder = folder
        self.path = folder / "busd.sock"
        self.processes: dict[int, Process] = {}
        self.publishers: dict[int, bus.Publisher[Numbered]] = {}
        self.subscriptions: dict[int, bus.Subscription[Numbered]] = {}
        self.received: dict[int, list[tuple[int, int]]] = {}
        self.model = model.Model()
        self._shares = shares
        self._limits = limits
        self._ids = 0
        self._is_large: set[int] = set()

    async def open(self) -> None:
        self.start_busd()
        for shares in self._shares:
            await self.open_process(shares=shares)

    async def close(self) -> None:
        await self.unblock_all()
        for process in self.processes.values():
            await process.node.close()
        self.stop_busd()

    # --- busd

    def start_busd(self) -> None:
        self.listener = open_listener(self.path)
        clock_ns = monotonic_offset_ns()
        self.broker = Broker(self._limits, uid=os.getuid(), pid=os.getpid(), clock_ns=clock_ns)
        self.server = Server(self.listener, self.broker)

    def stop_busd(self) -> None:
        """End busd as kill does, without any message."""
        for connection in tuple(self.server._connections):
            connection.close()
        self.server._alarm.close()
        self.server._admission.close()
        self.listener.close()

    def peer(self, process: int) -> PeerConnection:
        """The server's connection of that process."""
        node = self.broker.graph.nodes[self.processes[process].node._declared.id]  # type: ignore[index]
        return self.server._peers[node.peer.id]

    # --- processes

    async def open_process(self, *, shares: bool) -> int:
        self._ids += 1
        path = self.folder / f"{self._ids}.sock"
        path.symlink_to(self.path)
        node = bus.Node(f"node_{self._ids}", socket=path, arguments=[], rosout=False)
        with _route("" if shares else "socket"):
            await node.open()
        assert node._link is not None
        self.processes[self._ids] = Process(self._ids, node, node._link)
        if shares:
            self.model.sharing.add(self._ids)
        return self._ids

    async def die(self, process: int) -> None:
        """Kill a process: busd sees the end of the connection, and nothing is read or written any more."""
        self._forget(self.model.endpoints_of(process), is_lost=True)
        self.model.blocked.discard(process)
        dead = self.processes.pop(process)
        endpoints = tuple(dead.link._declarations)
        dead.link.release()
        dead.node._link = None  # a killed process closes no node, and warns of none
        for endpoint in endpoints:
            endpoint.end(ConnectionClosed("the process died"))
        await self.open_process(shares=process in self.model.sharing)

    def take_over(self, number: int) -> None:
        """The result depends on the order of returns: take all messages, and copy the counts."""
        expected = self.model.subscriptions[number]
        while self.take_one(number):
            pass
        totals = self.subscriptions[number].statistics()
        assert totals.expected == totals.delivered + sum(totals.dropped.values())
        last: dict[int, int] = {}
        for publisher, seq in self.received[number]:
            assert seq > last.get(publisher, 0)
            last[publisher] = seq
        self._see(expected, totals)
        expected.take_over(self.received[number], totals.dropped)

    def block(self, process: int, *, is_silent: bool = False) -> None:
        """Let the process stop reading its socket. If it `is_silent`, others do not wait for it."""
        self.model.blocked.add(process)
        connection = self.peer(process)
        connection.stream.writing = WriteState.BLOCKED
        if is_silent:
            now_ns = monotonic_ns()
            self.broker.entrance._silences._begin(now_ns, self.broker._peers[connection.id], 0)
            self.server._effects.carry_out(self.broker.tick(now_ns))
            self.server._effects.flush()

    async def unblock_all(self) -> None:
        for process in sorted(self.model.blocked):
            stream = self.peer(process).stream
            stream.writing = WriteState.OPEN
            stream._handlers.before_write()
            stream.flush()
            self.model.unblock(process)
        await self.settle()

    # --- endpoints

    async def create_publisher(self, process: int, qos: QoSProfile) -> None:
        self.model.add_publisher(await self.make_publisher(process, qos))

    async def make_publisher(self, process: int, qos: QoSProfile) -> model.Publisher:
        self._ids += 1
        number, node = self._ids, self.processes[process].node
        self.publishers[number] = await node.create_publisher(Numbered, TOPIC, qos)
        return model.Publisher(number, process, qos)

    async def create_subscription(self, process: int, qos: QoSProfile) -> None:
        self._ids += 1
        node = self.processes[process].node
        self.subscriptions[self._ids] = await node.create_subscription(Numbered, TOPIC, qos)
        self.received[self._ids] = []
        # In busd's order: by their numbers there.
        self.model.publishers = {
            number: self.model.publishers[number]
            for number in sorted(self.publishers, key=lambda number: self.publishers[number]._core.id)
        }
        self.model.add_subscription(model.Subscription(self._ids, process, qos))

    async def close_endpoint(self, endpoint: int) -> None:
        closing = self.publishers.get(endpoint) or self.subscriptions[endpoint]
        self._forget([endpoint])
        await closing.close()

    def publish(self, publisher: int, count: int, size: int = 1) -> list[model.Message]:
        """Publish; returns the messages taken: a keep-all publisher may have no room."""
        real, origin = self.publishers[publisher], self.model.publishers[publisher]
        if size > 1000:
            self._is_large.add(publisher)
        taken = 0
        for _ in range(count):
            if not real.publish(Numbered(publisher, origin.published + taken + 1, "x" * size)):
                assert origin.qos.is_lossless
                break
            taken += 1
        return self.model.publish(origin, taken)

    def refuse(self, publisher: int, subscription: int, *, by_publisher: bool) -> None:
        """One end reports that it can't share memory in this match."""
        writer, reader = self.publishers[publisher], self.subscriptions[subscription]
        ends = (writer, reader) if by_publisher else (reader, writer)
        refusal = m.RefuseRoute(endpoint=ends[0]._core.id, other=ends[1]._core.id, text="a test")
        ends[0]._core.link.send_about(ends[0]._core, refusal)
        self.model.reroute(self.model.publishers[publisher], self.model.subscriptions[subscription])

    async def refuse_late(
        self, publisher: int, subscription: int, bursts: list[tuple[int, int]], *, by_publisher: bool
    ) -> None:
        """The subscription is told late to leave the ring, and has read some of it by then."""
        expected = self.model.subscriptions[subscription]
        self.block(expected.process)
        dropped = expected.dropped.copy()
        self.refuse(publisher, subscription, by_publisher=by_publisher)
        for number, count in bursts:
            self.model.deliver(self.model.publishers[number], self.publish(number, count, 1))
            await self.settle()
            self.take_one(subscription)
        await self.unblock_all()
        expected.dropped = dropped
        self.take_over(subscription)

    def take(self, subscription: int, count: int) -> None:
        """Take up to `count` messages, and compare them with the model's."""
        expected = self.model.subscriptions[subscription]
        for _ in range(count):
            if [self.take_one(subscription), expected.take() is not None] == [False, False]:
                break
        self.compare(subscription)

    def take_one(self, subscription: int) -> bool:
        taken = self.subscriptions[subscription].take()
        if taken is None:
            return False
        message, info = taken
        assert info.publication_sequence_number == message.number
        assert info.reception_sequence_number == len(self.received[subscription]) + 1
        self.received[subscription].append((message.publisher, message.number))
        return True

    # --- checks

    async def settle(self) -> None:
        """Wait until no message is in transit, except to processes that do not read."""
        async with asyncio.timeout(WAIT_S):
            for _ in range(3):  # agreeing on a ring takes this many
                await asyncio.gather(*(one.ask() for one in self._hearing()))
            while not self._is_idle():  # noqa: ASYNC110
                await asyncio.sleep(0)
            await asyncio.gather(*(one.ask() for one in self._hearing()))

    def compare(self, number: int) -> None:
        """Compare the results that the program of that subscription sees."""
        expected = self.model.subscriptions[number]
        totals = self.subscriptions[number].statistics()
        self._allow(expected, totals)
        agree(number, self.received[number], expected.received)
        agree(number, (totals.delivered, totals.queued), (len(expected.received), expected.queued))
        if expected.process not in self.model.blocked:
            agree(number, totals.publishers, len(expected.routes))
            agree(number, (totals.expected, totals.dropped), (expected.expected, dict(+expected.dropped)))
            agree(number, totals.expected, totals.delivered + totals.queued + sum(totals.dropped.values()))

    async def check(self) -> None:
        await self.settle()
        for number in self.subscriptions:
            self.compare(number)
        for process in self.processes.values():
            process.link._reports._send_totals(list(process.link._declarations))
        await self.settle()
        graph = whole_graph(self.broker.graph, statistics=True)
        records = {one.gid: one.statistics for one in graph.endpoints}
        for number, subscription in self.subscriptions.items():
            expected, found = self.model.subscriptions[number], records[subscription.gid]
            assert found is not None
            queued = expected.queued + len(expected.at_busd.messages)
            agree(number, (found.samples, found.queued), (len(expected.received), queued))
            agree(number, (found.expected, found.dropped), (expected.expected, dict(+expected.dropped)))
            agree(number, found.expected, found.samples + found.queued + sum(found.dropped.values()))
        routes = {(one.publisher, one.subscription): one.route for one in graph.matches}
        assert routes == {
            (self.publishers[publisher]._core.id, self.subscriptions[number]._core.id): route
            for number, one in self.model.subscriptions.items()
            for publisher, route in one.routes.items()
        }

    # --- inside

    def _hearing(self) -> list[Process]:
        return [
            process
            for number, process in self.processes.items()
            if number not in self.model.blocked and process.gate.is_set()
        ]

    def _is_idle(self) -> bool:
        if self.broker.timers.earliest_ns <= monotonic_ns():
            return False
        for number, process in self.processes.items():
            stream, gathered = process.stream, process.link.gathered
            if stream is None or not process.gate.is_set():
                continue
            far = self.peer(number).stream
            if gathered or stream.outbox or stream.writing is not WriteState.OPEN or not far.is_quiet:
                return False
            if number not in self.model.blocked and (
                far.outbox or far.writing is not WriteState.OPEN or not stream.is_quiet
            ):
                return False
        return True

    def _allow(self, expected: model.Subscription, totals: bus.SubscriptionStatistics) -> None:
        """Allow differences with causes outside of the model."""
        # A ring of large messages may drop history beyond all depths before a late joiner takes it.
        rings = expected.in_rings
        while self._is_large and expected.queued > totals.queued and len(rings.messages) > rings.depth:
            rings.pop()
            expected.dropped["replaced"] += 1
        self._see(expected, totals)

    def _see(self, expected: model.Subscription, totals: bus.SubscriptionStatistics) -> None:
        """Count unseen messages before the next message: others got them by socket, too, or busd is new."""
        for publisher, messages in tuple(expected.unseen.items()):
            if totals.expected >= expected.expected + len(messages):
                expected.see(publisher)

    def _forget(self, endpoints: list[int], *, is_lost: bool = False) -> None:
        for number in endpoints:
            self.publishers.pop(number, None)
            self.subscriptions.pop(number, None)
            self.model.remove(number, is_lost=is_lost)


def agree(subscription: int, found: object, expected: object) -> None:
    assert found == expected, f"subscription {subscription}: {found}, and should be {expected}"


@contextmanager
def _route(name: str) -> Iterator[None]:
    before = os.environ.get("BUS_ROUTE")
    os.environ["BUS_ROUTE"] = name
    try:
        yield
    finally:
        if before is None:
            del os.environ["BUS_ROUTE"]
        else:
            os.environ["BUS_ROUTE"] = before

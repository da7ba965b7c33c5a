"""busd.server.passing: runs passed on as they lie in the reader's buffer, and the cost of that."""

import asyncio
import os
import socket
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from bus.qos import QoSProfile
from bus.transport.stream_state import WriteState
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, PROTOCOL_VERSION
from bus.wire.runs import Run
from bus.wire.session import Role, Session
from busd.core.broker import Broker
from busd.core.turns import BUDGET
from busd.server.credentials import Credentials
from busd.server.listener import open_listener
from busd.server.peer import PeerConnection
from busd.server.server import Server
from conftest import WAIT_S
from feeding import feed, frame_record
from stepcount import StepCounter, counts_bytecodes

KIND: dict[str, Any] = {"type_name": "test/msg/Text", "type_hash": "hash"}
UID = os.getuid()


class Peer:
    """A process of a server, at the other end of a socket pair."""

    _numbers = count(1)

    def __init__(self, server: Server) -> None:
        self.server = server
        inner, self.sock = socket.socketpair()
        inner.setblocking(False)
        self.sock.setblocking(False)
        who = Credentials(pid=os.getpid(), uid=UID, gid=os.getgid())
        server.let_in(inner, who, m.Hello(version=PROTOCOL_VERSION, program="test"))
        self.connection: PeerConnection = max(server._peers.values(), key=lambda one: one.id)
        self._session = Session(Role.CLIENT)
        self._waiting: list[Any] = []

    async def get(self, wanted: Callable[[Any], bool]) -> Any:
        """The next item for which `wanted` is true. Items before it are dropped."""
        async with asyncio.timeout(WAIT_S):
            while True:
                while self._waiting:
                    if wanted(item := self._waiting.pop(0)):
                        return item
                await asyncio.sleep(0)
                try:
                    self._waiting += feed(self._session, self.sock.recv(1 << 20))
                except BlockingIOError:
                    pass

    async def run(self) -> tuple[int, int, int, bytes]:
        """Endpoint, source, first number and body of the next run."""
        run = await self.get(lambda item: isinstance(item, Run))
        return run.endpoint, run.source, run.first_seq, bytes(run.body)

    async def make(self, kind: type[Any], topic: str, **more: Any) -> int:
        """Make a publisher or subscription with its own node. Returns its number."""
        numbers = [next(Peer._numbers) for _ in range(2)]
        self.sock.send(
            m.encode_frame(m.DeclareType(**KIND))
            + m.encode_frame(m.CreateNode(request=numbers[0], name=f"node_{numbers[0]}", namespace="/"))
        )
        node = (await self.get(lambda item: getattr(item, "request", 0) == numbers[0])).id
        qos = QoSProfile(depth=10)
        asked = kind(request=numbers[1], node=node, topic=topic, qos=qos, gid=os.urandom(16), **KIND, **more)
        self.sock.send(m.encode_frame(asked))
        return int((await self.get(lambda item: getattr(item, "request", 0) == numbers[1])).id)


class Counted:
    """A socket that records calls."""

    def __init__(self, sock: socket.socket, calls: list[str]) -> None:
        self._sock = sock
        self._calls = calls
        self.fileno = sock.fileno

    def __getattr__(self, name: str) -> object:
        self._calls.append(name)
        return getattr(self._sock, name)

    def __enter__(self) -> None:
        self._sock.__enter__()

    def __exit__(self, *_: object) -> None:
        self._sock.__exit__()


class Pair:
    """A publisher and its only subscription."""

    def __init__(self, talker: Peer, listener: Peer) -> None:
        self.talker = talker
        self.listener = listener
        self.source = self.endpoint = 0
        self.next_seq = 1

    async def declare(self, topic: str) -> "Pair":
        self.endpoint = await self.listener.make(m.CreateSubscription, topic, last_seqs={})
        self.source = await self.talker.make(m.CreatePublisher, topic)
        return self

    def frame(self, body: bytes) -> bytes:
        head = DATA_HEAD.pack(
            DATA_HEAD_BYTES - LENGTH_BYTES + len(body), DATA, 0, 0, self.source, 0, self.next_seq, 1, 0
        )
        self.next_seq += 1
        return head + body


@pytest.fixture
async def server(tmp_path: Path) -> Any:
    with open_listener(tmp_path / "busd.sock") as listener:
        server = Server(listener, Broker(uid=UID))
        yield server
        for connection in tuple(server._connections):
            connection.close()
        server.stop("a test")
        await server.stopped


async def test_some_runs_for_some_in_one_read(server: Server) -> None:
    """Each subscription gets its own runs in order, whatever else is in the read."""
    talker, one, other = (Peer(server) for _ in range(3))
    first = await Pair(talker, one).declare("/first")
    second = await Pair(talker, other).declare("/second")
    bodies = [frame_record(bytes([at]) * 10 * at, at) for at in range(6)]
    talker.sock.send(
        first.frame(bodies[0])
        + first.frame(bodies[1])
        + second.frame(bodies[2])
        + m.encode_frame(m.Ping(number=7))
        + first.frame(bodies[3])
        + second.frame(bodies[4])[:20]
    )
    assert await one.run() == (first.endpoint, first.source, 1, bodies[0])
    assert await one.run() == (first.endpoint, first.source, 2, bodies[1])
    assert await one.run() == (first.endpoint, first.source, 3, bodies[3])
    assert await other.run() == (second.endpoint, second.source, 1, bodies[2])
    assert (await talker.get(lambda item: isinstance(item, m.Pong))).number == 7
    second.next_seq -= 1
    talker.sock.send(second.frame(bodies[4])[20:])
    assert await other.run() == (second.endpoint, second.source, 2, bodies[4])
    for peer in (talker, one, other):
        peer.sock.close()


async def test_what_the_socket_does_not_take_waits_in_order(server: Server) -> None:
    """Such runs wait within the depth. A partly sent run is sent to its end."""
    talker, listener = Peer(server), Peer(server)
    pair = await Pair(talker, listener).declare("/topic")
    sent = 0
    async with asyncio.timeout(WAIT_S):
        while listener.connection.stream.writing is WriteState.OPEN:
            talker.sock.send(pair.frame(frame_record(bytes([sent % 251]) * 30_000, sent)))
            sent += 1
            await asyncio.sleep(0)
    talker.sock.send(pair.frame(frame_record(b"the last", sent)))
    sent += 1
    for at in range(sent):
        _, _, seq, body = await listener.run()
        assert seq == at + 1
        expected = frame_record(b"the last" if seq == sent else bytes([at % 251]) * 30_000, at)
        assert body == expected
    talker.sock.close()
    listener.sock.close()


async def test_what_is_sent_is_paid_for(server: Server) -> None:
    """So a process that sends much has its turns, too. A short run costs the read and the frame."""
    talker, listener = Peer(server), Peer(server)
    pair = await Pair(talker, listener).declare("/topic")
    party, paid = talker.connection.party, list[int]()
    for size in (64, 40 << 10):
        await asyncio.sleep(0.01)
        party.refill(time.monotonic_ns())
        assert party.left == BUDGET
        talker.sock.send(pair.frame(frame_record(bytes(size), 1)))
        talker.connection.stream._on_readable()
        paid.append(BUDGET - party.left)
        await listener.run()
    assert paid == [8, 18]
    talker.sock.close()
    listener.sock.close()


async def fan(server: Server, listeners: list[Peer], talker: Peer) -> tuple[Pair, list[int]]:
    """A publisher and a subscription of each listener on a topic. Returns the subscriptions' numbers, too."""
    numbers = [await one.make(m.CreateSubscription, "/topic", last_seqs={}) for one in listeners]
    pair = Pair(talker, listeners[0])
    pair.source = await talker.make(m.CreatePublisher, "/topic")
    return pair, numbers


async def test_a_lone_run_for_several_processes_is_sent_to_each_of_them(server: Server) -> None:
    talker, *listeners = (Peer(server) for _ in range(4))
    pair, numbers = await fan(server, listeners, talker)
    bodies = [frame_record(bytes([at]) * 50, at) for at in range(5)]
    calls = list[str]()
    for one in listeners:
        one.connection.stream._sock = Counted(one.connection.stream._sock, calls)  # type: ignore[assignment]
    party = talker.connection.party
    while party.left < BUDGET:
        await asyncio.sleep(0)
        party.refill(time.monotonic_ns())
    talker.sock.send(pair.frame(bodies[0]))
    talker.connection.stream._on_readable()
    assert calls == ["send"] * 3
    assert BUDGET - party.left == 8 + 3 * 4
    talker.sock.send(pair.frame(bodies[1]) + pair.frame(bodies[2]))  # not alone: by the queues
    talker.connection.stream._on_readable()
    assert calls == ["send"] * 6
    talker.sock.send(pair.frame(bodies[3]) + m.encode_frame(m.Ping(number=7)))
    talker.sock.send(pair.frame(bodies[4]))
    for number, one in zip(numbers, listeners, strict=True):
        for at, body in enumerate(bodies):
            assert await one.run() == (number, pair.source, at + 1, body)
    for peer in (talker, *listeners):
        peer.sock.close()


async def test_one_of_several_that_does_not_read_gets_all_in_order(server: Server) -> None:
    talker, fast, slow = (Peer(server) for _ in range(3))
    pair, numbers = await fan(server, [fast, slow], talker)
    sent = 0
    while slow.connection.stream.is_idle:
        talker.sock.send(pair.frame(frame_record(bytes([sent]) * 30_000, sent)))
        sent += 1
        assert (await fast.run())[2] == sent
    for _ in range(3):
        talker.sock.send(pair.frame(frame_record(bytes([sent]) * 30_000, sent)))
        sent += 1
        assert (await fast.run())[2] == sent
    for at in range(sent):
        expected = (numbers[1], pair.source, at + 1, frame_record(bytes([at]) * 30_000, at))
        assert await slow.run() == expected
    for peer in (talker, fast, slow):
        peer.sock.close()


async def test_two_subscriptions_of_one_of_several_processes(server: Server) -> None:
    talker, one, other = (Peer(server) for _ in range(3))
    pair, numbers = await fan(server, [one, one, other], talker)
    body = frame_record(b"x", 1)
    talker.sock.send(pair.frame(body))
    got = {await one.run(), await one.run(), await other.run()}
    assert got == {(number, pair.source, 1, body) for number in numbers}
    for peer in (talker, one, other):
        peer.sock.close()


async def test_one_that_has_gone_harms_nobody(server: Server) -> None:
    talker, listener, other = (Peer(server) for _ in range(3))
    pair = await Pair(talker, listener).declare("/topic")
    second = await Pair(talker, other).declare("/second")
    listener.sock.close()
    talker.sock.send(pair.frame(frame_record(b"x", 1)) + second.frame(frame_record(b"y", 1)))
    assert await other.run() == (second.endpoint, second.source, 1, frame_record(b"y", 1))
    talker.sock.close()
    other.sock.close()


async def test_one_that_the_core_has_yet_to_forget(server: Server) -> None:
    """The core removes the parts of a process from the graph in pieces. Its connection goes first."""
    talker, listener = Peer(server), Peer(server)
    pair = await Pair(talker, listener).declare("/topic")
    gone = server._peers.pop(listener.connection.id)
    talker.sock.send(pair.frame(frame_record(b"x", 1)) + m.encode_frame(m.Ping(number=7)))
    assert (await talker.get(lambda item: isinstance(item, m.Pong))).number == 7
    server._peers[gone.id] = gone
    talker.sock.close()
    listener.sock.close()


@counts_bytecodes
async def test_a_lone_message_costs_few_steps(server: Server) -> None:
    talker, listener = Peer(server), Peer(server)
    pair = await Pair(talker, listener).declare("/topic")
    body = frame_record(bytes(64), 1)
    for _ in range(3):
        talker.sock.send(pair.frame(body))
        await listener.run()
    talker.sock.send(pair.frame(body))
    calls = list[str]()
    for peer in (talker, listener):
        stream = peer.connection.stream
        stream._sock = Counted(stream._sock, calls)  # type: ignore[assignment]
    with StepCounter() as steps:
        talker.connection.stream._on_readable()
    assert (await listener.run())[2] == 4
    assert 100 < steps.bytecodes < 747
    assert calls == ["recvmsg_into", "send"]
    talker.sock.close()
    listener.sock.close()

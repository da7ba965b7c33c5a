"""A client that asks too much of busd, all the time, as fast as it goes: the neighbour of fairness.py.

    python -m benchmarks.adapters.flooding <Flood as JSON>

It speaks the wire itself, as the library would not do such things. Says `ready` when it floods, and on the
word `report` `flooded` with what it did since then: `asked`, and `refused` of these. Who is cut off comes
again.
"""

import os
import select
import socket
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from time import monotonic_ns
from typing import Any, Literal

import msgspec

from benchmarks.worker import tell
from bus.address import socket_path
from bus.msg.std_msgs import String
from bus.qos import History, QoSProfile
from bus.typesupport import type_support
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, RECORD_HEAD, VERSION
from bus.wire.session import Role, Session

Kind = Literal["busy loop", "socket", "samples", "declarations", "queries", "connections", "shared memory"]

_STRING = type_support(String)
_BATCH = 64
_KEEP_ALL = QoSProfile(history=History.KEEP_ALL)
_RUNS = 16
_BLOCK_BYTES, _STRIDE = 100_000, 4
"""What a socket is given at once, and which part of it is looked at: much like samples for busd."""
_TIMEOUT_S = 20.0
_CUT_OFF = (ConnectionError, TimeoutError)


class Flood(msgspec.Struct, frozen=True):
    """What it does.

    busy loop: nothing but use a CPU. socket: writes to a process of its own, without the bus. samples: many
    small messages by socket, in runs, to a subscription of its own that keeps all and reads nothing.
    declarations: creates and destroys publishers. queries: asks for the graph with statistics. connections:
    comes, says Hello, and goes. shared memory: a publisher of the library that floods a subscription of its
    own process.
    """

    kind: Kind


class Peer:
    """A connection to busd that has said Hello. Raises OSError."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.settimeout(_TIMEOUT_S)
            self._socket.connect(str(socket_path()))
            self._session = Session(Role.CLIENT)
            self._requests = count(1)
            self.send(m.Hello(version=VERSION, program="flooder"))
            self._expect(m.Hello)
        except BaseException:
            self._socket.close()
            raise

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)

    def send(self, *messages: m.Message) -> None:
        self.write(b"".join(map(m.encode_frame, messages)))

    def ask(self, *requests: Callable[[int], m.Message]) -> list[Any]:
        """All of them at once; returns the answers."""
        numbers = [next(self._requests) for _ in requests]
        self.send(*(make(number) for make, number in zip(requests, numbers, strict=True)))
        waiting, answers = set(numbers), []
        for message in self._received():
            if (number := getattr(message, "request", None)) in waiting:
                waiting.discard(number)
                answers.append(message)
                if not waiting:
                    break
        return answers

    def node(self) -> int:
        """Declare a node and the type String; returns the node's id."""
        self.send(m.DeclareType(type_name=_STRING.name, type_hash=_STRING.hash))
        (created,) = self.ask(lambda number: m.CreateNode(request=number, name="flooder"))
        return int(created.id)

    def _expect(self, kind: type[m.Message]) -> None:
        for message in self._received():
            if isinstance(message, kind):
                return

    def _received(self) -> Iterator[Any]:
        """What comes, until nobody asks for more; the rest of a read is passed over."""
        while True:
            size = self._socket.recv_into(self._session.reader.get_buffer())
            if not size:
                raise ConnectionResetError("busd has ended the connection")
            yield from list(self._session.received(size))


class Tally:
    """What was done, and the parent's words."""

    def __init__(self) -> None:
        self.asked = self.refused = 0
        self._is_ready = False
        self._poll = select.poll()
        self._poll.register(0, select.POLLIN)

    def add(self, asked: int, refused: int = 0) -> bool:
        """So much more was done; returns whether to go on."""
        self.asked += asked
        self.refused += refused
        if not self._is_ready:
            self._is_ready = True
            tell("ready")
        while self._poll.poll(0):
            word = sys.stdin.readline()
            if not word:
                return False
            if word.strip() == "report":
                tell("flooded", asked=self.asked, refused=self.refused)
                self.asked = self.refused = 0
        return True


def _refused(answers: list[Any]) -> int:
    return sum(isinstance(answer, m.Refused) for answer in answers)


def _endpoint(node: int, topic: str, gids: "count[int]", **changes: Any) -> dict[str, Any]:
    named = {"type_name": _STRING.name, "type_hash": _STRING.hash, "qos": QoSProfile()}
    return {"node": node, "topic": topic, "gid": struct.pack("<QQ", 1, next(gids)), **named, **changes}


def _busy_loop(tally: Tally) -> None:
    while tally.add(1):
        end_ns = monotonic_ns() + 1_000_000
        while monotonic_ns() < end_ns:
            pass


def _socket(tally: Tally) -> None:
    ours, others = socket.socketpair()
    if os.fork() == 0:
        ours.close()
        buffer = bytearray(_BLOCK_BYTES)
        while size := others.recv_into(buffer):
            sum(buffer[:size:_STRIDE])
        os._exit(0)
    others.close()
    block = bytes(_BLOCK_BYTES)
    with ours:
        while tally.add(1):
            ours.sendall(block)


def _samples(tally: Tally) -> None:
    gids = count(1)
    text = bytes(_STRING.encode(String(data="x" * 64)))
    with ExitStack() as stack:
        sleeper, talker = stack.enter_context(Peer()), stack.enter_context(Peer())
        hears = _endpoint(sleeper.node(), "/flood", gids, qos=_KEEP_ALL)
        sleeper.ask(lambda number: m.CreateSubscription(request=number, **hears))
        says = _endpoint(talker.node(), "/flood", gids)
        (created,) = talker.ask(lambda number: m.CreatePublisher(request=number, **says))
        body = b"".join(RECORD_HEAD.pack(len(text), monotonic_ns()) + text for _ in range(_BATCH))
        length, seq = DATA_HEAD_BYTES - LENGTH_BYTES + len(body), 1
        while True:
            frames = []
            for _ in range(_RUNS):
                head = DATA_HEAD.pack(length, DATA, 0, 0, created.id, 0, seq, _BATCH, 0)
                frames += [head, body]
                seq += _BATCH
            talker.write(b"".join(frames))
            if not tally.add(_RUNS * _BATCH):
                return


def _declarations(tally: Tally) -> None:
    gids = count(1)
    with Peer() as peer:
        node = peer.node()

        def create(number: int) -> m.Message:
            return m.CreatePublisher(request=number, **_endpoint(node, f"/flood_{number % 100}", gids))

        while True:
            answers = peer.ask(*[create] * _BATCH)
            made = [answer.id for answer in answers if isinstance(answer, m.Created)]
            peer.send(*(m.DestroyEndpoint(endpoint=one) for one in made))
            if not tally.add(_BATCH + len(made), _refused(answers)):
                return


def _queries(tally: Tally) -> None:
    with Peer() as peer:
        while True:
            asked = [lambda number: m.GetGraph(request=number, statistics=True)] * _BATCH
            if not tally.add(_BATCH, _refused(peer.ask(*asked))):
                return


def _connections(tally: Tally) -> None:
    while True:
        with Peer():
            pass
        if not tally.add(1):
            return


def _shared_memory(tally: Tally) -> None:
    import asyncio

    import bus
    from bus.runner import loop_factory

    async def flood() -> None:
        async with bus.Node("flooder") as node:
            await node.create_subscription(String, "flood", 10, lambda message: None)
            pub = await node.create_publisher(String, "flood", 10)
            await pub.wait_for_subscriptions()
            message = String(data="x" * 64)
            while tally.add(_BATCH):
                for _ in range(_BATCH):
                    pub.publish(message)
                await asyncio.sleep(0)

    with asyncio.Runner(loop_factory=loop_factory()) as runner:
        runner.run(flood())


_FLOODS: dict[str, Callable[[Tally], None]] = {
    "busy loop": _busy_loop,
    "socket": _socket,
    "samples": _samples,
    "declarations": _declarations,
    "queries": _queries,
    "connections": _connections,
    "shared memory": _shared_memory,
}


def main() -> None:
    flood = _FLOODS[msgspec.json.decode(sys.argv[-1].encode(), type=Flood).kind]
    tally = Tally()
    while True:
        try:
            flood(tally)
            return
        except _CUT_OFF:
            if not tally.add(0, 1):
                return


if __name__ == "__main__":
    main()

"""A client with a hostile broker, without a socket.

For any messages of the broker: the client ends the connection or continues, and its answers are well-formed.
"""

import asyncio
import os
from contextlib import suppress
from typing import Any

import msgspec

from bus.base.descriptor import Descriptor
from bus.endpoint.core import EndpointCore, NodeContext
from bus.endpoint.endpoint import core_of
from bus.errors import BusError, RemoteProtocolError
from bus.events import PublisherEvents, SubscriptionEvents
from bus.graph import graph_of
from bus.link.connection import Connection
from bus.link.declarations import LinkNode
from bus.link.link import Link
from bus.logger import get_logger
from bus.msg.std_msgs import String
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.shm import segments
from bus.subscription import Subscription
from bus.transport.stream_state import WriteState
from bus.types.support import type_support
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
)
from bus.wire.runs import Buffer
from bus.wire.session import Role, Session
from feeding import feed, frame_record
from fuzz.hostile_ring import HostileRing
from fuzz.script import Script

_LOSSLESS: dict[str, Any] = {"history": "keep_all", "durability": "transient_local"}
_PROFILES: tuple[dict[str, Any], ...] = (
    {},
    {"depth": 2, "durability": "transient_local"},
    _LOSSLESS,
    {"lifespan": 1.0},
)
_GIDS = tuple(bytes([number]) * 16 for number in range(4))
_OTHERS = range(100, 104)
_SHORT = ("liveliness", "lost", "refused", "done", "pong", "ping", "graph*", "type=", "leaving")
"""Messages with few fields."""


class _Silent:
    """A stream to the broker that takes nothing."""

    is_quiet = True
    writing = WriteState.OPEN

    def flush(self) -> None:
        pass

    def send_now(self, frame: Buffer) -> bool:
        return False

    def finish(self) -> None:
        pass

    def close(self) -> None:
        pass


def client(data: bytes) -> None:
    """Messages of a broker to a process with two publishers and two subscriptions."""
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(_talk(Script(data)))


async def _talk(script: Script) -> None:
    faults: list[Any] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda loop, context: faults.append(context))
    told = _Client(script)
    try:
        await told.begin()
        while script and not told.is_cut:
            told.act(script.byte() % 16)
            await asyncio.sleep(0)
            told.check()
    finally:
        await told.end()
    assert not faults, faults
    told.check()


class _Client:
    def __init__(self, script: Script) -> None:
        self.script = script
        self.is_cut = False
        self.link = Link("/nowhere")
        self.session = Session(Role.CLIENT)
        self.connection = Connection(
            self.link.shm_context,
            on_received=self.link._incoming.received,
            on_lost=lambda reason: None,
            on_wrote=lambda: None,
        )
        self.connection._stream = _Silent()  # type: ignore[assignment]
        self.link.connection = self.connection
        self.link._users = 1
        self.rings: list[HostileRing] = []
        self.asked: list[asyncio.Task[Any]] = []
        logger, support = get_logger("fuzz"), type_support(String)
        lossless = QoSProfile(**_LOSSLESS)
        node = NodeContext(self.link, "/node", logger, self.fail)
        logger.set_level("FATAL")
        self.publishers: list[Publisher[String]] = [
            Publisher(node, "/a", support, qos, PublisherEvents()) for qos in (QoSProfile(depth=3), lossless)
        ]
        self.subscriptions: list[Subscription[String]] = [
            Subscription(node, "/a", support, qos, SubscriptionEvents())
            for qos in (QoSProfile(depth=3), lossless)
        ]

    @property
    def cores(self) -> list[EndpointCore[String]]:
        return [core_of(one) for one in (*self.publishers, *self.subscriptions)]

    def fail(self, error: BaseException) -> None:
        raise error

    async def begin(self) -> None:
        """Declare everything, to a broker that answers well or not."""
        node = self.node = LinkNode("node", "/", None, (__file__, 0))  # the link refers to it weakly
        self.hear(m.encode_frame(m.Hello(version=1)))
        everything: list[LinkNode | EndpointCore[String]] = [node, *self.cores]
        for number, what in enumerate(everything, 1):
            if isinstance(what, LinkNode):
                task = asyncio.create_task(self.link.declare_node(what))
            else:
                task = asyncio.create_task(self.link.declare(node, what))
            self.asked.append(task)
            await asyncio.sleep(0)
            if self.script.byte() < 240:
                fields = {
                    "depth": 3,
                    "max_message_bytes": 1 << 16,
                    "window_samples": 8,
                    "window_bytes": 1 << 10,
                }
                self.say("created", request=number, id=number, ring_bytes=1 << 20, **fields)
            else:
                names = ("depth", "max_message_bytes", "window_samples", "window_bytes", "ring_bytes")
                fields = {name: self.script.number() for name in names if self.script.byte() & 1}
                self.say("created", request=number, id=self.script.number(number), **fields)
            await asyncio.sleep(0)
            asked = next(self.connection.numbers)
            graph = self.connection.request(asked, m.GetGraph(request=asked), m.GraphSnapshot)
            self.asked.append(asyncio.create_task(graph))

    def act(self, act: int) -> None:
        script = self.script
        mine, other, number = 1 + script.byte() % 6, self.other(), script.number
        match act:
            case 0 | 1 | 2:
                route = script.choose(("shm", "socket", "x"))
                fields = {"next_seq": number(1)} if script.byte() & 1 else {}
                fields |= {"at_ns": number()} if script.byte() & 1 else {}
                fields |= {"uid": number(1000)} if script.byte() & 1 else {}
                gid, qos = script.choose(_GIDS), script.choose(_PROFILES)
                matched = {
                    "endpoint": mine,
                    "other": other,
                    "node": "/n",
                    "gid": gid,
                    "qos": qos,
                    "route": route,
                }
                self.say("matched", brings=2, **matched, **fields)
            case 3:
                fields = {"publisher": mine, "subscription": other, "slot": number()}
                fields |= {"uid": number(1000)} if script.byte() & 1 else {}
                self.say("attached", brings=2, **fields, process=1, pid=number())
            case 4:
                self.say("ring*", brings=1, subscription=mine, source=other)
            case 5:
                fields = {"at_ns": number(), "last_seq": number()}
                self.say("rerouted", endpoint=mine, other=other, route="socket", **fields)
            case 6:
                is_lost = bool(script.byte() & 1)
                self.say("unmatched", endpoint=mine, other=other, lost=is_lost, last_seq=number())
            case 7:
                self.say("dropped", subscription=mine, dropped={"replaced": number(), "x": number()})
            case 8:
                self.say("credit", publisher=mine, seq=number())
            case 9:
                tag = script.choose(_SHORT)
                numbers = {name: number() for name in ("used", "limit", "number", "revision", "request")}
                about = {"subscription": mine, "publisher": other, "alive": bool(script.byte() & 1)}
                about |= {"publisher": mine} if tag == "lost" else {}
                self.say(
                    tag, **numbers, **about, text="no", resource=script.choose(("", "x")), schema=b"\xc0"
                )
            case 10:
                self.graph(number)
            case 11:
                incompatible: dict[str, Any] = {"endpoint": mine, "topic": "/a", "node": "/n", "text": "no"}
                self.say("incompatible", **incompatible, policy=script.choose(("TYPE", "x")))
            case 12 | 13:
                self.run(mine, other)
            case 14:
                with suppress(BusError):
                    script.choose(self.publishers).publish(String(data="x" * script.byte()))
                subscription = script.choose(self.subscriptions)
                if self.rings:
                    self.rings[-1].scribble(script)
                subscription.take()
                subscription.statistics()
            case _:
                self.hear(script.take(script.byte()))

    def other(self) -> int:
        byte = self.script.byte()
        return _OTHERS[byte % len(_OTHERS)] if byte < 240 else self.script.number()

    def run(self, endpoint: int, source: int) -> None:
        script = self.script
        how, first_seq = script.byte(), abs(script.number(1))
        count = 1 + (how & 3)
        payload = msgspec.msgpack.encode(String(data="x" * script.byte()))
        stamp_ns = min(script.number(), (1 << 63) - 1)
        body = frame_record(payload, stamp_ns) * count if how & 4 else script.take(script.byte())
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        ids = endpoint & 0xFFFFFFFF, source & 0xFFFFFFFF
        self.hear(DATA_HEAD.pack(length, DATA, how >> 6, 0, *ids, first_seq, count, 0) + body)

    def graph(self, number: Any) -> None:
        node = {"id": number(), "name": "n", "namespace": "/", "pid": number()}
        endpoint = {"id": number(), "kind": "publisher", "node": number(), "topic": "/a", "gid": b""}
        endpoint |= {"type_name": "x", "type_hash": "y", "qos": {}}
        records: dict[str, Any] = {"nodes": [node], "endpoints": [endpoint], "matches": []}
        self.say("graph", request=1 + self.script.byte() % 16, revision=number(), **records)

    def say(self, tag: str, *, brings: int = 0, **fields: Any) -> None:
        if brings and self.script.byte() < 224:
            fields["descriptors"] = brings
            kinds = self.script.byte()
            batch = tuple(self.descriptor(kinds >> 4 * at & 15) for at in range(brings))
            self.session.descriptors.append(batch[: len(batch) - (kinds == 255)])
        body = msgspec.msgpack.encode({"m": tag, **fields})
        self.hear(FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body)

    def descriptor(self, kind: int) -> Descriptor:
        """A ring, mostly with a fault in it; or a descriptor of another kind."""
        shm_context = self.link.shm_context
        if shm_context is None or kind == 0:
            return Descriptor(os.open("/dev/null", os.O_RDONLY))
        if kind < 3:
            return segments.make_doorbell()
        if kind < 5:
            return segments.make_readers(1 + kind % 4)[0]
        if kind < 8 and self.rings:
            return self.rings[-1].pass_on()
        self.rings.append(HostileRing(self.script))
        return self.rings[-1].pass_on()

    def hear(self, raw: bytes) -> None:
        if self.is_cut:
            return
        try:
            for item in feed(self.session, raw):
                self.link._incoming.received([item])
        except RemoteProtocolError:
            self.is_cut = True

    def check(self) -> None:
        """Check that all its messages can be decoded."""
        for endpoint in self.cores:
            if endpoint.id:
                self.link.send_about(endpoint, endpoint.totals())
        receiver = Session(Role.BROKER)
        list(feed(receiver, m.encode_frame(m.Hello(version=1))))
        while (taken := self.connection.outbox.take())[1]:
            if taken[2]:
                receiver.descriptors.append(taken[2])
            list(feed(receiver, b"".join(taken[0])))

    async def end(self) -> None:
        for ended in reversed(self.cores):
            self.link.forget(ended)
            ended.end(BusError("the end"))
        self.link.release()
        for task in self.asked:
            task.cancel()
        for answer in await asyncio.gather(*self.asked, return_exceptions=True):
            if isinstance(answer, m.GraphSnapshot):
                with suppress(RemoteProtocolError):
                    graph_of(answer)
            elif isinstance(answer, BaseException):
                assert isinstance(answer, BusError | asyncio.CancelledError), answer
        self.session.drop_descriptors()

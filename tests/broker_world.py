"""A broker and the processes around it, without sockets or a clock.

`World` does what the daemon's shell does: it carries out effects, sends what queues hold to processes that
read, and lets the broker trim. Everything goes through the real wire both ways, so a message that could not
be sent fails here too.

    world = World()
    talker, listener = world.process(), world.process()
    subscription = listener.subscription("/topic", QoSProfile(depth=3))
    publisher = talker.publisher("/topic")
    publisher.publish("one", "two")
    assert subscription.payloads == ["one", "two"]
    listener.is_blocked = True      # does not read any more
"""

from collections.abc import Iterable
from itertools import count
from typing import Any, NamedTuple, TypeVar

import msgspec

from bus.errors import RemoteProtocolError
from bus.ids import PeerId
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, VERSION
from bus.wire.outbox import Outbox
from bus.wire.runs import Run
from bus.wire.session import Role, Session
from busd.core.broker import Broker
from busd.core.effects import Disconnect, Effect, Flush, Note, Send, Stop
from busd.core.limits import Limits, TopicRule
from feeding import feed, frame_record

SECOND = 1_000_000_000
UID = 1000
TEXT = ("test_msgs/msg/Text", "hash-1")
NUMBER = ("test_msgs/msg/Number", "hash-2")

Answer = TypeVar("Answer", bound=m.Message)


class Refusal(Exception):
    """The broker answered Refused; `answer` is that message."""

    def __init__(self, answer: m.Refused) -> None:
        super().__init__(answer.text)
        self.answer = answer


class Sample(NamedTuple):
    """One sample as its subscription's process got it."""

    source: int
    seq: int
    payload: str
    stamp_ns: int
    is_replay: bool


class World:
    """One broker with a clock that stands still until `advance`."""

    def __init__(self, limits: Limits | None = None, rules: tuple[TopicRule, ...] = ()) -> None:
        self.broker = Broker(limits, rules, uid=UID, pid=1)
        self.now_ns = 1_000 * SECOND
        self.processes: dict[PeerId, Process] = {}
        self.notes: list[str] = []
        self.stop_reason: str | None = None
        self.gids = count(1)

    def process(self, program: str = "program", *, uid: int = UID) -> "Process":
        """A process that has connected and said Hello."""
        return Process(self, program, uid)

    def advance(self, seconds: float) -> None:
        """Let time pass, with every tick in between that the broker asks for."""
        end_ns = self.now_ns + round(seconds * SECOND)
        while (due_ns := self.broker.next_deadline_ns()) is not None and due_ns <= end_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self.carry_out(self.broker.tick(self.now_ns))
            again_ns = self.broker.next_deadline_ns()
            assert again_ns is None or again_ns > self.now_ns, "a tick leaves nothing that is due"
        self.now_ns = end_ns

    def carry_out(self, effects: list[Effect]) -> None:
        """Do what the daemon's shell does with the broker's effects, then send."""
        for effect in effects:
            match effect:
                case Send(peer, message):
                    if peer in self.processes:
                        self.processes[peer].sent.append(message)
                        self.processes[peer].outbox.put(m.encode_frame(message))
                case Flush(peer, queue):
                    if peer in self.processes:
                        self.processes[peer].outbox.make_ready(queue)
                case Disconnect(peer, reason):
                    self.processes.pop(peer).cut(reason)
                case Note(_, text):
                    self.notes.append(text)
                case Stop(reason):
                    self.stop_reason = reason
        for process in self.processes.values():
            if not process.is_blocked:
                process.read()


class Process:
    """A client process: its connection, and what came over it.

    While `is_blocked`, its socket takes nothing more.
    """

    def __init__(self, world: World, program: str, uid: int) -> None:
        self.world = world
        self.outbox = Outbox()
        self.is_blocked = False
        self.cut_reason: str | None = None
        self.sent: list[Any] = []  # by the broker, read or not
        self.messages: list[Any] = []
        self.samples: dict[int, list[Sample]] = {}
        self.undecodable: dict[int, int] = {}
        self._requests = count(1)
        self._types: set[tuple[str, str]] = set()
        self._node: Node | None = None
        self._to_broker = Session(Role.BROKER, max_message_bytes=world.broker.limits.message_bytes)
        self._from_broker = Session(Role.CLIENT)
        (hello,) = feed(self._to_broker, m.encode_frame(m.Hello(version=VERSION, program=program)))
        self.id = world.broker.attach(world.now_ns, hello, pid=100 + len(world.processes), uid=uid)
        world.processes[self.id] = self
        self.outbox.put(m.encode_frame(m.Hello(version=VERSION)))
        self.read()

    # --- to the broker

    def tell(self, message: m.Message) -> None:
        """Send a control message."""
        self.send_bytes(m.encode_frame(message))

    def request(self, message: m.Message, kind: type[Answer]) -> Answer:
        """Send a message with a `request` of 0 and return its answer, read or not; raises Refusal."""
        number = next(self._requests)
        before = len(self.sent)
        self.tell(msgspec.structs.replace(message, request=number))
        (answer,) = (one for one in self.sent[before:] if getattr(one, "request", None) == number)
        if isinstance(answer, m.Refused):
            raise Refusal(answer)
        assert isinstance(answer, kind)
        return answer

    def send_bytes(self, data: bytes) -> None:
        """Send bytes, whatever they mean."""
        world, broker = self.world, self.world.broker
        try:
            for item in feed(self._to_broker, data):
                if isinstance(item, Run):
                    world.carry_out(broker.route(world.now_ns, self.id, item))
                    if broker.is_overfull:
                        world.carry_out(broker.trim(world.now_ns))
                else:
                    world.carry_out(broker.handle(world.now_ns, self.id, item))
                if self.cut_reason is not None:
                    return
        except RemoteProtocolError as error:
            self.outbox.put(m.encode_frame(m.Fault(text=str(error))))
            del world.processes[self.id]
            self.cut(str(error))
            world.carry_out(broker.detach(world.now_ns, self.id))

    def die(self) -> None:
        """The process is gone; its socket closes."""
        del self.world.processes[self.id]
        self.world.carry_out(self.world.broker.detach(self.world.now_ns, self.id))

    # --- from the broker

    def read(self) -> None:
        """Take everything that waits."""
        while (taken := self.outbox.take())[1]:
            for item in feed(self._from_broker, b"".join(taken[0])):
                if isinstance(item, Run):
                    samples = _samples(item)
                    self.samples.setdefault(item.endpoint, []).extend(samples)
                    missing = item.count - len(samples)
                    self.undecodable[item.endpoint] = self.undecodable.get(item.endpoint, 0) + missing
                else:
                    self.messages.append(item)

    def unblock(self) -> None:
        """The socket takes bytes again, and the process reads all of them."""
        self.is_blocked = False
        self.world.carry_out(self.world.broker.expire(self.world.now_ns, self.id))

    def cut(self, reason: str) -> None:
        self.cut_reason = reason
        if not self.is_blocked:
            self.read()

    def got(self, kind: type[Answer]) -> list[Answer]:
        """All messages of one kind that have come, oldest first."""
        return [message for message in self.messages if isinstance(message, kind)]

    # --- what it makes

    def node(self, name: str = "node", namespace: str = "/") -> "Node":
        answer = self.request(m.CreateNode(request=0, name=name, namespace=namespace), m.Created)
        return Node(self, answer.id)

    def publisher(self, topic: str, qos: QoSProfile | None = None, **more: Any) -> "Publisher":
        return self._own_node().publisher(topic, qos, **more)

    def subscription(self, topic: str, qos: QoSProfile | None = None, **more: Any) -> "Subscription":
        return self._own_node().subscription(topic, qos, **more)

    def declare_type(self, kind: tuple[str, str]) -> None:
        if kind not in self._types:
            self._types.add(kind)
            self.tell(m.DeclareType(type_name=kind[0], type_hash=kind[1]))

    def graph(self, *, statistics: bool = False) -> m.Graph:
        return self.request(m.GetGraph(request=0, statistics=statistics), m.Graph)

    def _own_node(self) -> "Node":
        if self._node is None:
            self._node = self.node(f"node_{self.id}")
        return self._node


class Node:
    def __init__(self, process: Process, number: int) -> None:
        self.process = process
        self.id = number

    def publisher(
        self,
        topic: str,
        qos: QoSProfile | None = None,
        *,
        kind: tuple[str, str] = TEXT,
        gid: bytes | None = None,
        next_seq: int = 1,
    ) -> "Publisher":
        gid = gid or next(self.process.world.gids).to_bytes(16, "big")
        self.process.declare_type(kind)
        message = m.CreatePublisher(
            request=0,
            node=self.id,
            topic=topic,
            type_name=kind[0],
            type_hash=kind[1],
            qos=qos or QoSProfile(),
            gid=gid,
            next_seq=next_seq,
        )
        return Publisher(self.process, self.process.request(message, m.Created), gid, next_seq)

    def subscription(
        self,
        topic: str,
        qos: QoSProfile | None = None,
        *,
        kind: tuple[str, str] = TEXT,
        gid: bytes | None = None,
        last_seqs: dict[bytes, int] | None = None,
    ) -> "Subscription":
        gid = gid or next(self.process.world.gids).to_bytes(16, "big")
        self.process.declare_type(kind)
        message = m.CreateSubscription(
            request=0,
            node=self.id,
            topic=topic,
            type_name=kind[0],
            type_hash=kind[1],
            qos=qos or QoSProfile(),
            gid=gid,
            last_seqs=last_seqs or {},
        )
        return Subscription(self.process, self.process.request(message, m.Created), gid)

    def destroy(self) -> None:
        self.process.tell(m.DestroyNode(node=self.id))


class _Endpoint:
    def __init__(self, process: Process, created: m.Created, gid: bytes) -> None:
        self.process = process
        self.created = created
        self.id = created.id
        self.gid = gid

    def statistics(self, asker: Process | None = None) -> m.EndpointStatistics:
        """The broker's counters, as `asker` (else the endpoint's own process) sees them in the graph."""
        records = (asker or self.process).graph(statistics=True).endpoints
        (found,) = (record.statistics for record in records if record.id == self.id)
        assert found is not None
        return found

    def got(self, kind: type[Answer]) -> list[Answer]:
        """The messages of one kind about this endpoint."""
        names = ("endpoint", "publisher" if isinstance(self, Publisher) else "subscription")
        return [
            one for one in self.process.got(kind) if any(getattr(one, name, 0) == self.id for name in names)
        ]

    def destroy(self) -> None:
        self.process.tell(m.DestroyEndpoint(endpoint=self.id))


class Publisher(_Endpoint):
    def __init__(self, process: Process, created: m.Created, gid: bytes, next_seq: int) -> None:
        super().__init__(process, created, gid)
        self.next_seq = next_seq

    def publish(self, *payloads: str, stamp_ns: int | None = None) -> None:
        """Publish all payloads in one run."""
        stamp_ns = self.process.world.now_ns if stamp_ns is None else stamp_ns
        body = b"".join(frame_record(payload.encode(), stamp_ns) for payload in payloads)
        self.publish_body(len(payloads), body)

    def publish_many(self, payloads: Iterable[str]) -> None:
        """Publish each payload in a run of its own."""
        for payload in payloads:
            self.publish(payload)

    def publish_body(self, count: int, body: bytes, *, first_seq: int | None = None) -> None:
        """Send a data frame with any body."""
        first_seq = self.next_seq if first_seq is None else first_seq
        self.next_seq = first_seq + count
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        head = DATA_HEAD.pack(length, DATA, 0, 0, self.id, 0, first_seq, count, 0)
        self.process.send_bytes(head + body)

    def lose(self, number: int) -> None:
        """The publisher's own queue replaced the next `number` samples before they were handed over."""
        self.next_seq += number


class Subscription(_Endpoint):
    @property
    def samples(self) -> list[Sample]:
        return self.process.samples.get(self.id, [])

    @property
    def payloads(self) -> list[str]:
        return [sample.payload for sample in self.samples]

    @property
    def undecodable(self) -> int:
        """Samples that came in runs shorter than they claim."""
        return self.process.undecodable.get(self.id, 0)

    def ack(self, publisher: Publisher, seq: int) -> None:
        self.process.tell(m.Ack(subscription=self.id, source=publisher.id, seq=seq))


class Line:
    """A world with one publisher and one subscription, in two processes."""

    def __init__(
        self,
        offered: QoSProfile | None = None,
        requested: QoSProfile | None = None,
        limits: Limits | None = None,
        rules: tuple[TopicRule, ...] = (),
    ) -> None:
        self.world = World(limits, rules)
        self.talker = self.world.process("talker")
        self.listener = self.world.process("listener")
        self.publisher = self.talker.publisher("/topic", offered)
        self.subscription = self.listener.subscription("/topic", requested)

    @property
    def dropped(self) -> dict[str, int]:
        """What the broker counts as dropped for the subscription."""
        return self.subscription.statistics(self.talker).dropped

    def told(self) -> list[dict[str, int]]:
        """What the subscription was told of drops."""
        return [message.dropped for message in self.subscription.got(m.Dropped)]


def _samples(run: Run) -> list[Sample]:
    return [
        Sample(
            run.source, run.first_seq + at, bytes(payload).decode(errors="replace"), stamp_ns, run.is_replay
        )
        for at, (payload, stamp_ns) in enumerate(run.records())
    ]

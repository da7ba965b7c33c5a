"""A broker and the processes around it, without sockets or a clock.

`World` does the work of the daemon's shell: it carries out effects, sends queued frames to processes that
read, and lets the broker trim. Everything goes through the real wire both ways, so a message that can't be
sent fails here too.

    world = World()
    talker, listener = world.process(), world.process()
    subscription = listener.subscription("/topic", QoSProfile(depth=3))
    publisher = talker.publisher("/topic")
    publisher.publish("one", "two")
    assert subscription.payloads == ["one", "two"]
    listener.is_blocked = True      # does not read any more

A process with `shares` can use the route shm; then its publishers have rings. Descriptors are names here.
"""

from collections.abc import Callable
from itertools import count
from typing import Any

import msgspec
import pytest

from broker_endpoints import Answer, Publisher, Sample, Subscription, ring_name
from bus.base.ids import PeerId
from bus.errors import RemoteProtocolError
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import FRAME_HEAD_BYTES, PROTOCOL_VERSION, SILENCE
from bus.wire.outbox import Outbox
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.session import Carried, Role, Session
from busd.core.access import Access, AccessRule
from busd.core.broker import Broker
from busd.core.effects import Disconnect, Effect, Flush, Later, Note, Pause, Send, Stop
from busd.core.graph import Graph
from busd.core.limits import Limits, TopicRule
from busd.core.snapshot import take_snapshot
from busd.core.work import UNLIMITED
from feeding import feed

SECOND = 1_000_000_000
UID = 1000
TEXT = ("test_msgs/msg/Text", "hash-1")
NUMBER = ("test_msgs/msg/Number", "hash-2")
ALL_MAY = AccessRule(topics=("**",), actions=frozenset({"publish", "subscribe", "observe"}), is_for_all=True)
"""A rule for tests in which access of strangers is not the subject."""


class Refusal(Exception):
    """The broker answered Refused; `answer` is that message."""

    def __init__(self, answer: m.Refused) -> None:
        super().__init__(answer.text)
        self.answer = answer


def refused(action: Callable[..., object], *arguments: Any, **more: Any) -> m.Refused:
    """The broker's answer to a request that it must refuse."""
    with pytest.raises(Refusal) as caught:
        action(*arguments, **more)
    return caught.value.answer


class Handle:
    """A replacement for a descriptor."""

    def __init__(self, name: str) -> None:
        self.name = name

    def close(self) -> None:
        self.name = "closed"


def whole_graph(graph: Graph, *, statistics: bool = False) -> m.GraphSnapshot:
    """The whole graph, from inside the broker."""
    steps = take_snapshot(graph, 0, statistics=statistics, pid=1)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: m.GraphSnapshot = m.from_broker.decode(m.encode_frame(end.value)[FRAME_HEAD_BYTES:])
            return found


class World:
    """One broker with a clock that stands still until `advance`."""

    def __init__(
        self,
        limits: Limits | None = None,
        rules: tuple[TopicRule, ...] = (),
        access: tuple[AccessRule, ...] = (),
    ) -> None:
        self.alive: set[int] = set()
        """Pids of living processes, connected or not."""
        self.broker = Broker(
            limits, rules, Access(UID, access), uid=UID, pid=1, lives=self.alive.__contains__
        )
        self.now_ns = 1_000 * SECOND
        self.processes: dict[PeerId, Process] = {}
        self.notes: list[str] = []
        self.pauses: list[tuple[PeerId, int]] = []  # peers that are not read from, and for how long
        self.stop_reason: str | None = None
        self.budget = UNLIMITED
        """Work that the broker may do at a time; then it is the turn of others."""
        self.between: Callable[[], object] = lambda: None
        """Called between two pieces of long work."""
        self.overdrawn = 0
        """The largest overrun of the budget so far."""
        self.passed_on = 0
        """Runs that were passed on unchanged."""
        self.gids = count(1)
        self.pids = count(100)

    def process(
        self,
        program: str = "program",
        *,
        uid: int = UID,
        shares: bool = False,
        capabilities: tuple[str, ...] = (),
        key: str | None = None,
        clock_ns: int = 0,
    ) -> "Process":
        """A process that has connected and sent Hello, and perhaps Share.

        `key` identifies a process without a pid in busd's pid namespace. `clock_ns`: as in Hello.
        """
        process = Process(self, program, uid, capabilities, key, clock_ns)
        if shares:
            process.share()
        return process

    def advance(self, seconds: float) -> None:
        """Let time pass, with every tick that the broker asks for."""
        end_ns = self.now_ns + round(seconds * SECOND)
        while (due_ns := self.broker.next_deadline_ns()) is not None and due_ns <= end_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self.refill()
            self.carry_out(self.broker.tick(self.now_ns))
            again_ns = self.broker.next_deadline_ns()
            is_done = self.broker.meter.left > 0
            assert not is_done or again_ns is None or again_ns > self.now_ns, "a tick leaves what is due"
        self.now_ns = end_ns

    def whole_graph(self, *, statistics: bool = False) -> m.GraphSnapshot:
        """The graph, from inside the broker."""
        return whole_graph(self.broker.graph, statistics=statistics)

    def carry_out(self, effects: list[Effect]) -> None:
        """Carry out the broker's effects as the daemon's shell does, then send; then continue with others."""
        self.overdrawn = max(self.overdrawn, -self.broker.meter.left)
        late: list[PeerId] = []
        for effect in effects:
            match effect:
                case Send(peer, message, descriptors):
                    if peer in self.processes:
                        frame = m.encode_frame(message)
                        if isinstance(message, m.GraphSnapshot):  # the broker has encoded parts of it
                            message = m.from_broker.decode(frame[FRAME_HEAD_BYTES:])
                        self.processes[peer].sent.append(message)
                        self.processes[peer].outbox.put(frame, descriptors)
                case Flush(peer, queue):
                    if peer in self.processes:
                        self.processes[peer].outbox.make_ready(queue)
                case Later(peer):
                    late.append(peer)
                case Disconnect(peer, reason):
                    self.processes.pop(peer).cut(reason)
                case Note(_, text):
                    self.notes.append(text)
                case Pause(peer, pause_ns):
                    self.pauses.append((peer, pause_ns))
                case Stop(reason):
                    self.stop_reason = reason
        for process in tuple(self.processes.values()):
            if not process.is_blocked:
                process.read()
        for peer in late:
            self.between()
            if self.broker.tasks.has_work(peer):
                self.refill()
                self.carry_out(self.broker.go_on(self.now_ns, peer))
                if self.broker.is_overfull:
                    self.carry_out(self.broker.trim(self.now_ns))

    def refill(self) -> None:
        """Start a turn with the whole budget."""
        self.broker.meter.left = self.budget


class Process:
    """A client process: its connection, and the messages received over it.

    While `is_blocked`, its socket takes nothing more.
    """

    def __init__(
        self,
        world: World,
        program: str,
        uid: int,
        capabilities: tuple[str, ...] = (),
        key: str | None = None,
        clock_ns: int = 0,
    ) -> None:
        self.world = world
        self.outbox = Outbox()
        self.is_blocked = False
        self.shares = False
        self.has_read = 0
        """The last number read from a ring that has to be left."""
        self.cut_reason: str | None = None
        self.sent: list[Any] = []  # by the broker, read or not
        self.messages: list[Any] = []
        self.carried: list[tuple[Any, list[str]]] = []
        self.samples: dict[int, list[Sample]] = {}
        self.undecodable: dict[int, int] = {}
        self._requests = count(1)
        self._types: set[tuple[str, str]] = set()
        self._node: Node | None = None
        self._to_broker = Session(Role.BROKER, max_message_bytes=world.broker.settings.limits.message_bytes)
        self._from_broker = Session(Role.CLIENT)
        greeting = m.Hello(
            version=PROTOCOL_VERSION,
            capabilities=(SILENCE, *capabilities),
            program=program,
            clock_ns=clock_ns,
        )
        (hello,) = feed(self._to_broker, m.encode_frame(greeting))
        self.pid = next(world.pids) if key is None else 0
        world.alive.add(self.pid)
        self.id = world.broker.entrance.attach(world.now_ns, hello, pid=self.pid, uid=uid, process=key)
        world.processes[self.id] = self
        self.outbox.put(m.encode_frame(m.Hello(version=PROTOCOL_VERSION)))
        self.read()

    # --- to the broker

    def tell(self, message: m.Message, *handles: str) -> None:
        """Send a control message with its descriptors."""
        if handles:
            self._to_broker.descriptors.append(tuple(map(Handle, handles)))  # type: ignore[arg-type]
        self.send_bytes(m.encode_frame(message))

    def share(self) -> None:
        self.shares = True
        self.tell(m.Share(), f"doorbell {self.id}", f"readers {self.id}")

    def request(self, message: m.Message, kind: type[Answer], *handles: str) -> Answer:
        """Send a message with a `request` of 0 and return its answer, read or not; raises Refusal."""
        number = next(self._requests)
        before = len(self.sent)
        self.tell(msgspec.structs.replace(message, request=number), *handles)
        (answer,) = (one for one in self.sent[before:] if getattr(one, "request", None) == number)
        if isinstance(answer, m.Refused):
            raise Refusal(answer)
        assert isinstance(answer, kind)
        return answer

    def send_bytes(self, data: bytes) -> None:
        """Send any bytes."""
        world, broker = self.world, self.world.broker
        try:
            for item in feed(self._to_broker, data):
                world.refill()
                if isinstance(item, Run):
                    if not self._is_passed_on(item):
                        world.carry_out(broker.route(world.now_ns, self.id, item))
                    if broker.is_overfull:
                        world.carry_out(broker.trim(world.now_ns))
                elif isinstance(item, Carried):
                    world.carry_out(broker.handle(world.now_ns, self.id, *item))
                else:
                    world.carry_out(broker.handle(world.now_ns, self.id, item))
                if self.cut_reason is not None:
                    return
        except RemoteProtocolError as error:
            self.outbox.put(m.encode_frame(m.Fault(text=str(error))))
            del world.processes[self.id]
            self.cut(str(error))
            world.carry_out(broker.detach(world.now_ns, self.id))

    def _is_passed_on(self, run: Run) -> bool:
        """Do the same as the daemon's shell with a lone run for processes without queued frames."""
        world, broker = self.world, self.world.broker
        if run.only_for or run.is_replay or run.is_resumed:
            return False
        publisher = broker.passage(world.now_ns, self.id, run.endpoint)
        if publisher is None:
            return False
        takers = {}
        for subscription in publisher.routed.values():
            taker = world.processes.get(subscription.flush.peer)
            if taker is None or taker.is_blocked or taker.outbox or subscription.queue.runs:
                return False
            takers[taker] = subscription.id
        if len(takers) != len(publisher.routed):
            return False
        if not broker.passed_on(publisher, run.first_seq, run.count, len(run.body)):
            return False
        world.passed_on += 1
        run.source = publisher.id
        for taker, number in takers.items():
            queue = RunQueue(0, Account(1 << 40), number)
            queue.append(run)
            taker.hear(b"".join(queue.pop_frame()))
        return True

    def die(self) -> None:
        """End the process; its socket closes."""
        self.world.alive.discard(self.pid)
        self.lose()

    def lose(self) -> None:
        """Close its socket; the process lives on."""
        del self.world.processes[self.id]
        self.world.refill()
        self.world.carry_out(self.world.broker.detach(self.world.now_ns, self.id))

    # --- from the broker

    def read(self) -> None:
        """Read all queued frames. A subscription leaves its ring if it is told to."""
        left = list[m.LeaveRing]()
        while (taken := self.outbox.take())[1]:
            if taken[2]:
                self._from_broker.descriptors.append(taken[2])
            left += self.hear(b"".join(taken[0]))
        for one in left:
            self.tell(one)

    def hear(self, data: bytes) -> list[m.LeaveRing]:
        """Handle received bytes; returns the requests to leave a ring."""
        left = list[m.LeaveRing]()
        for item in feed(self._from_broker, data):
            if isinstance(item, Carried):
                self.messages.append(item.message)
                self.carried.append((item.message, [one.name for one in item.descriptors]))  # type: ignore[attr-defined]
            elif isinstance(item, Run):
                samples = _samples(item)
                self.samples.setdefault(item.endpoint, []).extend(samples)
                missing = item.count - len(samples)
                self.undecodable[item.endpoint] = self.undecodable.get(item.endpoint, 0) + missing
            else:
                self.messages.append(item)
                if isinstance(item, m.Rerouted) and item.endpoint in self.world.broker.graph.subscriptions:
                    left.append(m.LeaveRing(subscription=item.endpoint, source=item.other, seq=self.has_read))
        return left

    def unblock(self) -> None:
        """Let the socket take bytes again; the process reads all of them."""
        self.is_blocked = False
        self.world.carry_out(self.world.broker.expire(self.world.now_ns, self.id))

    def cut(self, reason: str) -> None:
        self.cut_reason = reason
        if not self.is_blocked:
            self.read()

    def got(self, kind: type[Answer]) -> list[Answer]:
        """All received messages of one kind, oldest first."""
        return [message for message in self.messages if isinstance(message, kind)]

    # --- its endpoints

    def node(self, name: str = "node", namespace: str = "/", origin: m.Origin | None = None) -> "Node":
        message = m.CreateNode(request=0, name=name, namespace=namespace, origin=origin)
        answer = self.request(message, m.Created)
        return Node(self, answer.id)

    def publisher(self, topic: str, qos: QoSProfile | None = None, **more: Any) -> "Publisher":
        return self._own_node().publisher(topic, qos, **more)

    def subscription(self, topic: str, qos: QoSProfile | None = None, **more: Any) -> "Subscription":
        return self._own_node().subscription(topic, qos, **more)

    def declare_type(self, kind: tuple[str, str], schema: bytes = b"") -> None:
        """Declare a type once; with a schema, each time."""
        if schema or kind not in self._types:
            self._types.add(kind)
            self.tell(m.DeclareType(type_name=kind[0], type_hash=kind[1], schema=schema or b"\xc0"))

    def graph(self, *, statistics: bool = False) -> m.GraphSnapshot:
        return self.request(m.GetGraph(request=0, statistics=statistics), m.GraphSnapshot)

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
        ring: bool | None = None,
        stands_for: bytes = b"",
    ) -> "Publisher":
        """Make a publisher; with a `ring` if the process shares memory, unless the argument decides."""
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
            descriptors=int(self.process.shares if ring is None else ring),
            stands_for=stands_for,
        )
        handles = [ring_name(gid)] * message.descriptors
        created = self.process.request(message, m.Created, *handles)
        return Publisher(self.process, created, gid, next_seq)

    def subscription(
        self,
        topic: str,
        qos: QoSProfile | None = None,
        *,
        kind: tuple[str, str] = TEXT,
        gid: bytes | None = None,
        last_seqs: dict[bytes, int] | None = None,
        takes_history: bool = False,
        local_only: bool = False,
        role: Any = "",
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
            takes_history=takes_history,
            local_only=local_only,
            role=role,
        )
        return Subscription(self.process, self.process.request(message, m.Created), gid)

    def destroy(self) -> None:
        self.process.tell(m.DestroyNode(node=self.id))


def _samples(run: Run) -> list[Sample]:
    return [
        Sample(
            run.source, run.first_seq + at, bytes(payload).decode(errors="replace"), stamp_ns, run.is_replay
        )
        for at, (payload, stamp_ns) in enumerate(run.records())
    ]

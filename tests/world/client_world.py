"""The whole bus without a process, a socket, an event loop or a clock: clients and the broker, back to back.

The publishers and subscriptions are the real ones of `bus`, over a port that is a list (`ListPort`). The
broker is busd's real one (`broker_world`). Between them is the real wire, and real rings if clients share
memory.

    world = ClientWorld()
    talker, listener = world.client(), world.client(shares=True)
    subscription = listener.subscription(QoSProfile(10))
    publisher = talker.publisher(QoSProfile(10))
    world.settle()
    talker.publish(publisher, 3)
    world.settle()
    assert listener.take(subscription) == [(1, 1), (1, 2), (1, 3)]

Nothing happens by itself. `Client.step` is one turn of a client's event loop. `Client.serve` lets the broker
read frames of one client. `ClientWorld.settle` repeats both until nothing is in transit. `advance` lets time
pass.
"""

import os
import select
from collections import deque
from collections.abc import Callable
from itertools import count
from types import SimpleNamespace
from typing import Any, ClassVar

import msgspec

import broker_world
from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.port import ShmPort
from bus.endpoint.core import NodeContext
from bus.errors import ConnectionClosed
from bus.events import PublisherEvents, SubscriptionEvents
from bus.link.declarations import _ABOUT
from bus.link.reports import Reports
from bus.logger import get_logger
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.shm import segments
from bus.subscription import Subscription
from bus.types.support import type_support
from bus.wire import messages as m
from bus.wire.layout import LEAVING, NAMESAKES, PLACES
from bus.wire.outbox import Outbox
from bus.wire.runs import Run
from bus.wire.session import Carried
from busd.core.broker import Broker
from busd.core.limits import Limits
from feeding import feed
from list_port import SECOND, Clock, ListPort

TOPIC = "/topic"
_SLOTS = 64
_BEAT_S = 2.0
_MOST_ROUNDS = 2_000


class Numbered(msgspec.Struct):
    publisher: int = 0
    number: int = 0
    padding: str = ""


SUPPORT = type_support(Numbered)


class ReaderProcess:
    """A process that reads rings of this one."""

    def __init__(
        self, segment: Descriptor, doorbell: Descriptor, is_alive: Callable[[], bool], *, is_here: bool
    ) -> None:
        self.doorbell = doorbell
        self.bell = shm.native.Bell(segments.map_readers(segment), doorbell.number)
        self.is_alive = is_alive
        self.is_here = is_here


class SharedMemory:
    """A `bus.delivery.port.ShmPort`; after a doorbell, `look` checks the rings."""

    def __init__(self, process_of: Callable[[tuple[int, int]], "Client"]) -> None:
        self.doorbell = segments.make_doorbell()
        self.segment, memory = segments.make_readers(_SLOTS)
        self.readers = shm.native.Readers(memory, self.doorbell.number)
        self.identity = segments.identity(self.segment)
        self._process_of = process_of
        self._free = deque(range(_SLOTS))
        self._processes: dict[tuple[int, int], ReaderProcess] = {}
        self._waiting: dict[Any, Callable[[], None]] = {}
        self._is_look_due = True
        self._poll = select.poll()
        self._poll.register(self.doorbell.number, select.POLLIN)

    def look(self) -> list[Any]:
        """The owners with new data; then it sleeps again. Without a doorbell, nothing."""
        if not self._is_look_due and not self._poll.poll(0):
            return []
        self._is_look_due = False
        owners = self.readers.deliver(False) or []
        for look in tuple(self._waiting.values()):
            look()
        more = self.readers.sleep()
        self._is_look_due = bool(more)
        return [*owners, *more]

    def close(self) -> None:
        self.readers.close()
        self._processes.clear()
        self._waiting.clear()
        self.doorbell.close()
        self.segment.close()

    # --- as the port

    def reader_process(self, segment: Descriptor, doorbell: Descriptor, pid: int) -> ReaderProcess:
        identity = segments.identity(segment)
        if identity not in self._processes:
            client = self._process_of(identity)
            self._processes[identity] = ReaderProcess(
                segment, doorbell, lambda: not client.is_dead, is_here=identity == self.identity
            )
        return self._processes[identity]

    def writer_doorbell(self, doorbell: Descriptor) -> Descriptor:
        return doorbell

    def allot_slot(self) -> int | None:
        return self._free.popleft() if self._free else None

    def give_back(self, slot: int) -> None:
        self._free.append(slot)

    def poll_soon(self) -> None:
        self._is_look_due = True

    def poll(self, owner: object, time_ns: int) -> None:
        assert not time_ns, "nobody polls here"

    def wait_for_room(self, writer: object, look: Callable[[], None]) -> None:
        self._waiting[writer] = look
        self.readers.has_writers = True

    def wake_waiting(self, writer: object) -> None:
        self._is_look_due |= writer in self._waiting

    def stop_waiting(self, writer: object) -> None:
        self._waiting.pop(writer, None)
        self.readers.has_writers = bool(self._waiting)


class Connection(broker_world.Process):
    """One connection of a client: `sent_up` has data for the broker, `arrived` data for the client."""

    def __init__(self, world: "ClientWorld", program: str) -> None:
        self.arrived: deque[tuple[bytes, tuple[Descriptor, ...]]] = deque()
        self.sent_up: deque[tuple[bytes, tuple[Descriptor, ...]]] = deque()
        self.has_ended = False
        super().__init__(world, program, broker_world.UID, (LEAVING, NAMESAKES, PLACES))

    def read(self) -> None:
        while (taken := self.outbox.take())[1]:
            self.arrived.append((b"".join(taken[0]), _copies(taken[2])))

    def trickle(self) -> None:
        """Read one queued frame: a full socket has room for no more. Control frames come first."""
        outbox = self.outbox
        if outbox.control:
            if isinstance(frame := outbox.control[0], bytes):  # not with descriptors
                outbox.control.popleft()
                outbox.account.charge(-len(frame))
                self.arrived.append((frame, ()))
        elif outbox.ready:
            queue = outbox.ready[0]
            self.arrived.append((b"".join(queue.pop_frame()), ()))
            if not queue.runs:
                outbox.ready.popleft()
                queue.is_ready = False

    def hear(self, data: bytes) -> list[m.LeaveRing]:
        self.arrived.append((bytes(data), ()))
        return []

    def cut(self, reason: str) -> None:
        super().cut(reason)
        self.has_ended = True

    def serve(self) -> bool:
        """Let the broker read one batch; returns whether there was any."""
        if not self.sent_up or self.has_ended:
            return False
        data, descriptors = self.sent_up.popleft()
        if descriptors:
            self._to_broker.descriptors.append(descriptors)
        self.world.now_ns += 1
        self.send_bytes(data)
        return True


class Client(ListPort):
    """A process with one node, in place of a `bus.link.link.Link`."""

    def __init__(
        self, world: "ClientWorld", number: int, *, shares: bool, origin: m.Origin | None = None
    ) -> None:
        super().__init__(world.clock)
        self.number = number
        self.origin = origin
        self.is_dead = False
        self.is_held = False
        """Whether its event loop has no turns."""
        self.wall_offset_ns = 0
        self.endpoints: dict[Any, None] = {}
        self.connection: Connection | None = None
        self.errors: list[BaseException] = []
        self._world = world
        link: Any = self
        self._context = NodeContext(link, f"/node_{number}", get_logger("t"), self.errors.append)
        self._by_id: dict[int, Any] = {}
        self._node = 0
        self._requests = count(1)
        self._asked: dict[int, Any] = {}
        self._is_receiving = False
        self._reports = Reports(SimpleNamespace(call_later=self.later), self._report)  # type: ignore[arg-type]
        if shares:
            self.shm_context: ShmPort | None = SharedMemory(world.process_of)
        self.is_away = True
        self.connect()

    # --- for tests

    def publisher(
        self, qos: QoSProfile, topic: str = TOPIC, support: Any = SUPPORT, **more: Any
    ) -> Publisher[Any]:
        made = Publisher(self._context, topic, support, qos, PublisherEvents(), **more)
        made._write = made._put  # type: ignore[method-assign, assignment]  # not by the machine's clock
        self._add(made._core)
        return made

    def subscription(
        self,
        qos: QoSProfile,
        callback: Callable[..., Any] | None = None,
        topic: str = TOPIC,
        support: Any = SUPPORT,
        **bridging: Any,
    ) -> Subscription[Any]:
        made = Subscription(self._context, topic, support, qos, SubscriptionEvents(), callback, **bridging)
        self._add(made._core)
        return made

    def publish(self, publisher: Publisher[Numbered], count: int = 1, padding: str = "") -> int:
        """Publish `count` numbered messages; returns how many were taken: fewer if there is no room."""
        for taken in range(count):
            number = publisher.statistics().published + 1
            if not publisher._put(
                SUPPORT.encode(Numbered(self._world.number_of(publisher._core), number, padding))
            ):
                return taken
        return count

    def take(self, subscription: Subscription[Numbered], most: int = 1 << 30) -> list[tuple[int, int]]:
        """Take queued messages: the publisher's number (in order of creation), and the message's number."""
        found: list[tuple[int, int]] = []
        while len(found) < most and (taken := subscription.take()) is not None:
            message, info = taken
            assert info.publication_sequence_number == message.number
            found.append((message.publisher, message.number))
        return found

    def close(self, endpoint: Any) -> None:
        """As `Endpoint.close`, for a publisher that has handed over as much as possible."""
        if isinstance(endpoint, Publisher):
            endpoint._core.hand_over()
        self.forget(endpoint._core)
        endpoint._core.end(ConnectionClosed("closed"))

    def forget(self, endpoint: Any) -> None:
        """As `Link.forget`."""
        self._gathered.pop(endpoint, None)
        self._reports.send_last(endpoint)
        self.endpoints.pop(endpoint, None)
        self._by_id.pop(endpoint.id, None)
        self._asked = {number: one for number, one in self._asked.items() if one is not endpoint}
        self.send_about(endpoint, m.DestroyEndpoint(endpoint=endpoint.id))
        endpoint.id = 0

    def connect(self) -> None:
        """Connect a client without a connection. It declares everything again."""
        assert self.connection is None and not self.is_dead
        self.connection = Connection(self._world, f"client {self.number}")
        self.is_away, self.outbox = False, Outbox()
        self.broker = 1, self._world.brokers
        self._has_shared = False
        self._asked.clear()
        self._request(
            self,
            lambda number: m.CreateNode(
                request=number, name=f"n{self.number}", namespace="/", origin=self.origin
            ),
        )
        self.later(_BEAT_S, self._beat, self.connection)

    def notice_end(self) -> None:
        """If the connection has ended, read the rest of its data, and its end."""
        while self.connection is not None and self.connection.has_ended:
            self.step()

    def hang_up(self) -> None:
        """End the connection; the broker learns of it first."""
        connection = self.connection
        assert connection is not None
        if not connection.has_ended:
            connection.has_ended = True
            connection.lose()
        self._lost()

    def die(self) -> None:
        """Kill the process: data written into its rings stay there."""
        self.is_dead = True
        if self.connection is not None and not self.connection.has_ended:
            self.connection.has_ended = True
            self.connection.die()
        self.is_away = True
        self.connection = None

    def end(self) -> None:
        """Release everything open at the end of the test."""
        self.is_dead = True
        for endpoint in self.endpoints:
            endpoint.refusal or endpoint.end(ConnectionClosed("the test is over"))
        if isinstance(self.shm_context, SharedMemory):
            self.shm_context.close()
        self.connection = None
        self.endpoints.clear()
        self.calls.clear()

    # --- single steps

    def step(self) -> bool:
        """A turn of its event loop; returns whether there was anything to do."""
        if self.is_dead or self.is_held:
            return False
        has_read = self._read()
        owners = self.shm_context.look() if isinstance(self.shm_context, SharedMemory) else []
        self._deliver(dict.fromkeys(owners))
        has_run = self.run_once()
        return has_read or bool(owners) or has_run

    def serve(self) -> bool:
        """Let the broker read some of its frames; returns whether there were any."""
        return self.connection is not None and self.connection.serve()

    # --- as the link

    def write(self, data: bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        if self.connection is not None and not self.connection.has_ended:
            self.connection.sent_up.append((data, _copies(descriptors)))

    def report(self, owner: Any) -> None:
        self._reports.add(owner)

    def is_quiet(self) -> bool:
        connection = self.connection
        return not self._is_receiving and (
            connection is None or not (connection.arrived or connection.has_ended)
        )

    def _add(self, endpoint: Any) -> None:
        self._world.number_of(endpoint)
        self.endpoints[endpoint] = None
        if self._node:
            self._declare(endpoint)

    def _declare(self, endpoint: Any) -> None:
        if isinstance(self.shm_context, SharedMemory) and not self._has_shared:
            self._has_shared = True
            self._send(m.Share(), (self.shm_context.doorbell, self.shm_context.segment))
        support = endpoint.support
        kind = m.DeclareType(type_name=support.name, type_hash=support.hash, schema=support.description)
        self._send(kind)
        self._request(endpoint, lambda number: endpoint.declaration(number, self._node), endpoint.shared)

    def _request(
        self, what: Any, make: Callable[[int], m.Message], descriptors: tuple[Descriptor, ...] = ()
    ) -> None:
        number = next(self._requests)
        self._asked[number] = what
        self._send(make(number), descriptors)

    def _send(self, message: m.Message, descriptors: tuple[Descriptor, ...] = ()) -> None:
        self.outbox.put(m.encode_frame(message), descriptors)
        self.flush()

    def _beat(self, connection: Connection) -> None:
        if self.connection is connection:
            self._send(m.Ping())
            self.later(_BEAT_S, self._beat, connection)

    def _report(self, endpoint: Any, frames: bytes) -> None:
        self.send_about(endpoint, frames)

    def _read(self) -> bool:
        connection = self.connection
        if connection is None:
            return False
        has_read = bool(connection.arrived)
        while connection.arrived and connection is self.connection:
            data, descriptors = connection.arrived.popleft()
            if descriptors:
                connection._from_broker.descriptors.append(descriptors)
            touched: dict[Any, None] = {}
            self._is_receiving = True
            for item in feed(connection._from_broker, data):
                if isinstance(item, Run):
                    subscription = self._by_id.get(item.endpoint)
                    if subscription is not None:
                        item.received_ns = self.now_ns()
                        touched[subscription] = None
                        subscription.receive_run(item)
                else:
                    self._handle(item)
            self._is_receiving = False
            self._deliver(touched)
        if connection.has_ended and connection is self.connection:
            self._lost()
            return True
        return has_read

    def _deliver(self, owners: dict[Any, None]) -> None:
        for owner in owners:
            owner.wake()
        self._reports.add_all(owners)

    def _handle(self, message: Any) -> None:
        descriptors: tuple[Descriptor, ...] = ()
        if isinstance(message, Carried):
            message, descriptors = message
        assert not isinstance(message, m.Fault | m.Refused), message
        if isinstance(message, m.Created):
            what = self._asked.pop(message.request, None)
            if what is self:
                self._node = message.id
                for endpoint in self.endpoints:
                    self._declare(endpoint)
            elif what is None:  # closed meanwhile
                self._send(m.DestroyEndpoint(endpoint=message.id))
            else:
                what.declared(message)
                self._by_id[message.id] = what
            if not self._asked:  # all are declared
                self.flush()
                self._drains.release()
        elif (field := _ABOUT.get(type(message))) is not None:
            endpoint = self._by_id.get(getattr(message, field))
            if endpoint is not None and not isinstance(message, m.Incompatible):  # it would need a task
                endpoint.handle(message, descriptors)

    def _lost(self) -> None:
        self.connection = None
        self.lose()
        self._node = 0
        self._by_id.clear()
        for endpoint in self.endpoints:
            endpoint.disconnected()


class ClientWorld(broker_world.World):
    """A broker and clients. The clock ticks at each read, and otherwise stands still until `advance`."""

    all_open: ClassVar[list["ClientWorld"]] = []

    def __init__(self, limits: Limits | None = None) -> None:
        self.clock = Clock()
        self.clients: list[Client] = []
        self.brokers = 1
        self._limits = limits
        self._numbers: dict[Any, int] = {}
        super().__init__(limits)
        ClientWorld.all_open.append(self)

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns

    @now_ns.setter
    def now_ns(self, now_ns: int) -> None:
        self.clock.now_ns = max(now_ns, self.clock.now_ns)

    def client(self, *, shares: bool = False, origin: m.Origin | None = None) -> Client:
        """A connected process."""
        client = Client(self, len(self.clients) + 1, shares=shares, origin=origin)
        self.clients.append(client)
        self.settle()
        return client

    def close(self) -> None:
        """Release everything open at the end of the test."""
        for client in self.clients:
            client.end()
        self.clock.forget()
        self.processes.clear()

    def process_of(self, identity: tuple[int, int]) -> Client:
        """The client with that segment of readers."""
        contexts = ((one, one.shm_context) for one in self.clients)
        return next(
            one for one, shm in contexts if isinstance(shm, SharedMemory) and shm.identity == identity
        )

    def number_of(self, core: Any) -> int:
        """The number of an endpoint, from 1, in order of creation."""
        return self._numbers.setdefault(core, len(self._numbers) + 1)

    def settle(self) -> None:
        """Let everything in transit arrive, except at held clients."""
        for _ in range(_MOST_ROUNDS):
            is_busy = False
            for client in self.clients:
                is_busy |= client.step()
                while client.serve():
                    is_busy = True
            if not is_busy:
                return
        raise AssertionError("it goes on and on")

    def advance(self, seconds: float) -> None:
        """Let time pass, with all timers of clients and the broker, in order."""
        end_ns = self.now_ns + round(seconds * SECOND)
        while True:
            dues = [due for due in (self.clock.next_ns(), self.broker.next_deadline_ns()) if due is not None]
            if not dues or min(dues) > end_ns:
                break
            self.now_ns = min(dues)
            self.clock.run_due()
            super().advance(0)
            self.settle()
        self.now_ns = end_ns
        self.settle()

    def restart_broker(self) -> None:
        """Kill the broker and start a new one, without connections."""
        for client in self.clients:
            if client.connection is not None:
                client.connection.has_ended = True
        self.processes.clear()
        self.brokers += 1
        self.broker = Broker(
            self._limits,
            (),
            self.broker.settings.access.guard.access,
            uid=broker_world.UID,
            pid=1,
            lives=self.alive.__contains__,
        )

    def connect_all(self) -> None:
        """Connect each client without a connection."""
        self.settle()
        for client in self.clients:
            if client.connection is None and not client.is_dead:
                client.connect()
        self.settle()


def _copies(descriptors: tuple[Descriptor, ...]) -> tuple[Descriptor, ...]:
    """Duplicates, as the kernel makes them for sent descriptors."""
    return tuple(Descriptor(os.dup(one.number)) for one in descriptors)

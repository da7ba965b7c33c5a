"""One connection to a broker, from Hello to the end: requests and answers, heartbeats, sending.

It ends with the first loss; the link reconnects. It passes samples and messages for endpoints to its owner.
"""

import os
from collections.abc import Callable, Iterable
from itertools import count
from time import monotonic_ns
from typing import Any, TypeVar

from bus.base.descriptor import Descriptor
from bus.base.time_namespace import monotonic_offset_ns
from bus.base.version import RELEASE
from bus.errors import (
    BrokerUnavailable,
    BusError,
    ConfigurationError,
    ConnectionClosed,
    RemoteProtocolError,
)
from bus.link.heartbeat import Heartbeat
from bus.link.reach import NotNow, Patience, open_socket, program_name
from bus.link.requests import Requests
from bus.link.shm_context import ShmContext
from bus.logger import get_logger
from bus.transport.stream import Handlers, Stream, trusting
from bus.transport.stream_state import WriteState
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.answers import expect
from bus.wire.layout import (
    FRAME_HEAD_BYTES,
    LEAVING,
    MAX_CONTROL_BYTES,
    NAMESAKES,
    PLACES,
    PROTOCOL_VERSION,
    SILENCE,
)
from bus.wire.outbox import Outbox
from bus.wire.runs import Buffer
from bus.wire.session import Role, Session

A = TypeVar("A", bound=m.Message)

_NEVER_NS = 1 << 63

_log = get_logger("bus")


class _PassingFault(RemoteProtocolError):
    """The broker refuses this process for a temporary reason."""


class Connection:
    """One connection; `open` connects it.

    `on_received(items)` gets the runs and messages of one read, and passes answers to `resolve`.
    `on_lost(reason)` is called once, unless `close` came first.
    """

    def __init__(
        self,
        shm_context: ShmContext | None,
        *,
        on_received: Callable[[Iterable[Any]], None],
        on_lost: Callable[[BusError], None],
        on_wrote: Callable[[], None],
    ) -> None:
        self.outbox = Outbox()
        self.path = ""
        self.hello = m.Hello(version=PROTOCOL_VERSION)
        """The broker's Hello, after the connection is open."""
        self._on_received = on_received
        self._on_lost = on_lost
        self._on_wrote = on_wrote
        self._stream: Stream | None = None
        self._unshared = shm_context
        """Shared memory not yet announced to the broker; None afterwards, and if no memory is shared."""
        self._loss: Exception | None = None
        """The cause of the connection's end; None also if the broker closed it without a message."""
        self._farewell = ""
        self.heard_ns = 0
        """Time of the last data from the broker; the owner sets it."""
        self.turn_ns = 0
        """Time of the last known turn of the event loop; every callback of ours sets it."""
        self.late_ns = _NEVER_NS
        """A turn after this time is late: call `note_standstill` before `turn_ns` or `heard_ns` is set."""
        self.numbers = count(1)
        """Numbers of requests; number 0 is Hello."""
        self._requests = Requests(self)
        self._heartbeat = Heartbeat(self._beat)
        self._types: set[tuple[str, str]] = set()

    async def open(self, path: str, patience: Patience, *, may_start: bool = True) -> None:
        """Connect to the broker at `path` (or start one, if allowed by `may_start`) and exchange Hellos.

        Raises BrokerUnavailable, or its subclass NotNow if a retry may help. Cancellation: closed.
        """
        self.path = path
        sock = await open_socket(path, patience, may_start=may_start)
        self._stream = Stream(
            sock,
            Session(Role.CLIENT),
            self.outbox,
            Handlers(on_received=self._on_received, on_lost=self._lost, before_write=self._on_wrote),
            None if self._unshared is None else trusting,
        )
        greeted = self._requests.begin(0)
        try:
            self.send(
                m.Hello(
                    version=PROTOCOL_VERSION,
                    capabilities=(LEAVING, NAMESAKES, SILENCE, PLACES),
                    pid=os.getpid(),
                    program=program_name(),
                    release=RELEASE,
                    clock_ns=monotonic_offset_ns(),
                )
            )
            self.hello = await greeted
        except TimeoutError as error:
            raise BrokerUnavailable(str(error)) from None
        except ConnectionClosed:
            raise self._refusal() from None
        finally:
            self._requests.waiting.pop(0, None)
            if not greeted.done() or greeted.cancelled() or greeted.exception():
                self.close()
        if self._stream is None:  # its last message came right after its Hello
            raise self._refusal()

    def _refusal(self) -> BrokerUnavailable:
        """The error for a connection that has ended before it could be used."""
        if not isinstance(self._loss, RemoteProtocolError):  # for example a broker that ends with a backlog
            return NotNow(f"busd at {self.path} closed the connection without a word")
        kind = NotNow if isinstance(self._loss, _PassingFault) else BrokerUnavailable
        return kind(f"busd at {self.path} refused this process: {self._loss}")

    def send(self, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """Send a control message, or a frame in order with these. Does nothing after the connection's end."""
        if self._stream is not None:
            self.outbox.put(message if isinstance(message, bytes) else m.encode_frame(message), descriptors)
            self._stream.flush()

    @property
    def is_quiet(self) -> bool:
        """Whether all received data was read."""
        return self._stream is None or self._stream.is_quiet

    def share(self) -> None:
        """Send this process's doorbell and segment, once for each connection, before the first endpoint."""
        if (context := self._unshared) is not None:
            self._unshared = None
            self.send(m.Share(), (context.doorbell, context.segment))

    @property
    def is_writing(self) -> bool:
        """Whether the socket has not accepted all data chosen for it."""
        return self._stream is not None and self._stream.writing is not WriteState.OPEN

    def flush(self) -> None:
        """Send queued data, as far as the socket accepts it."""
        if self._stream is not None:
            self._stream.flush()

    def send_now(self, frame: Buffer) -> bool:
        """Send a data frame at once if nothing is queued; returns whether it was sent."""
        return self._stream is not None and self._stream.send_now(frame)

    async def request(
        self, number: int, message: m.Message, kind: type[A], descriptors: tuple[Descriptor, ...] = ()
    ) -> A:
        """Send `message`, the request `number` (from `numbers`); returns the answer, which is a `kind`.

        Raises:

        - ConfigurationError, QuotaExceeded, AccessDenied: the broker refuses
        - TimeoutError: the broker sends nothing at all for ANSWER_S
        - RemoteProtocolError: the answer is of another kind
        - ConnectionClosed: the connection ends first
        """
        if self._stream is None:
            raise ConnectionClosed("the connection to busd is closed")
        answer = self._requests.begin(number)
        try:
            self.send(message, descriptors)
            return expect(await answer, kind)
        finally:
            self._requests.waiting.pop(number, None)

    def declare_type(self, support: TypeSupport[Any]) -> None:
        """Declare a message type, once for each connection.

        Raises ConfigurationError if its schema is longer than any busd would read.
        """
        if (support.name, support.hash) in self._types:
            return
        schema = support.description
        frame = m.encode_frame(m.DeclareType(type_name=support.name, type_hash=support.hash, schema=schema))
        if len(frame) - FRAME_HEAD_BYTES > MAX_CONTROL_BYTES:
            raise ConfigurationError(
                f"the schema of {support.name} has {len(schema)} bytes, "
                f"more than the {MAX_CONTROL_BYTES} that go to busd in one message"
            )
        self._types.add((support.name, support.hash))
        self.send(frame)

    def forget_type(self, support: TypeSupport[Any]) -> None:
        """Declare the type again with the next endpoint, because busd may have refused it."""
        self._types.discard((support.name, support.hash))

    def resolve(self, message: Any) -> bool:
        """Handle a message about the connection itself; returns False for other messages.

        Raises RemoteProtocolError for the broker's last message.
        """
        match message:
            case m.Ping(number=number):
                self.send(m.Pong(number=number))
            case m.Pong():
                pass
            case m.Fault(text=text):
                raise _PassingFault(text) if message.again else RemoteProtocolError(text)
            case m.Leaving(text=text):
                self._farewell = text
                if self._stream is not None:
                    self._stream.finish()
            case m.Hello() | m.Refused() | m.Created() | m.Done() | m.TypeDescription() | m.GraphSnapshot():
                request = self._requests.waiting.get(getattr(message, "request", 0))
                if request is not None and not request.answer.done():
                    request.answer.set_result(message)
            case _:
                return False
        return True

    def beat(self, interval_s: float) -> None:
        """Send a sign of life every `interval_s` seconds from now on."""
        if self._stream is not None:
            self.late_ns = self._heartbeat.start(interval_s)

    def note_standstill(self, now_ns: int) -> None:
        """Note that the event loop stood still.

        If this was longer than the lease, warn: the program caused it.
        """
        self.late_ns = _NEVER_NS
        turn_ns = max(self.turn_ns, self.heard_ns)
        if time := self._heartbeat.standstill(now_ns, turn_ns, self.hello.lease_s):
            _log.warning(f"this program's event loop stood still for {time}: what waited for it has gone on")

    def close(self) -> None:
        """Send the data that the socket still accepts, and end."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()
        self._finish(ConnectionClosed("the connection to busd is closed"))

    def abandon(self) -> None:
        """In the child of a fork: drop everything that belongs to the parent. So the parent's end ends the
        connection."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.abandon()

    def _beat(self, interval_s: float) -> None:
        if (now_ns := monotonic_ns()) > self.late_ns:
            self.note_standstill(now_ns)
        self.send(m.Ping())
        self.beat(interval_s)

    def _lost(self, error: Exception | None) -> None:
        self._loss, self._stream = error, None
        reason = ConnectionClosed(str(error) if error else self._farewell or "busd closed the connection")
        self._finish(reason)
        self._on_lost(reason)

    def _finish(self, reason: BusError) -> None:
        self._heartbeat.stop()
        self._requests.end(reason)

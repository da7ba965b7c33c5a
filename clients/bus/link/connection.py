"""One connection to a broker, from Hello to the end: requests and answers, heartbeats, what is sent.

It ends with the first loss; coming back is the link's work. It hands samples and news of endpoints to its
owner.
"""

import asyncio
import os
import sys
from collections.abc import Callable, Iterable
from itertools import count
from time import monotonic_ns
from typing import Any, TypeVar

import msgspec

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
from bus.link.reach import TELL_S, NotNow, Patience, no_answer, no_answer_yet, open_socket
from bus.link.shm_context import ShmContext
from bus.logger import get_logger
from bus.process.shared_loop import GuardedLoop
from bus.transport.stream import Stream
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

ANSWER_S = 10.0
"""How long a broker that owes an answer may say nothing at all before it counts as hung."""

_UNREAD_S = 0.05
"""How long until the next look where this process has not read yet what has come."""

_LATE_NS = 1_000_000_000
"""A timer that is so late shows that this event loop stood still."""
_NEVER_NS = 1 << 63

_log = get_logger("bus")


class _Request(msgspec.Struct):
    """A request that the broker has not answered yet."""

    answer: asyncio.Future[Any]
    since_ns: int


class Connection:
    """Made by `Connection.open`.

    `on_received(items)` gets the runs and messages of one read, and gives those that are answers to
    `resolve`; `on_lost(reason)` is called once, unless `close` came first.
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
        self._shm_context = shm_context
        self._has_shared = False
        self.hello = m.Hello(version=PROTOCOL_VERSION)
        """The broker's, once the connection is open."""
        self._on_received = on_received
        self._on_lost = on_lost
        self._on_wrote = on_wrote
        self._loop = asyncio.get_running_loop()
        self._path = ""
        self._stream: Stream | None = None
        self._loss: ConnectionClosed | None = None
        self._was_silent = False
        self._is_for_now = False
        self._farewell = ""
        self.heard_ns = 0
        """When anything last came from the broker; the owner sets it."""
        self.turn_ns = 0
        """When the event loop last had a turn; every callback of ours sets it."""
        self.late_ns = _NEVER_NS
        """After that a turn comes late: call `note_standstill` before `turn_ns` or `heard_ns` is set."""
        self._beat_ns = self._due_ns = 0  # since and until when the next sign of life is waited for
        self._told_ns = 0
        """When the log last said that the broker is silent; 0: never."""
        self._requests: dict[int, _Request] = {}
        self.numbers = count(1)
        """For requests, one each."""
        self._watch: asyncio.TimerHandle | None = None
        self._watch_ns = 0  # when that is due
        self._stood_still_ns = 0  # until then requests may not have left, nor answers been read
        self._types: set[tuple[str, str]] = set()
        self._heartbeat: asyncio.TimerHandle | None = None
        self._greeted: asyncio.Future[m.Hello] = self._loop.create_future()

    async def open(self, path: str, patience: Patience, *, may_start: bool = True) -> None:
        """Connect to the broker at `path` (or start one, if this `may_start` one) and exchange Hellos.

        Raises BrokerUnavailable; of that NotNow where another try may help. Cancellation: closed.
        """
        self._path = path
        sock = await open_socket(path, patience, may_start=may_start)
        self._stream = Stream(
            sock,
            Session(Role.CLIENT),
            self.outbox,
            on_received=self._on_received,
            on_lost=self._lost,
            takes_descriptors=self._shm_context is not None,
        )
        self._stream.before_write(self._on_wrote)
        self.send(
            m.Hello(
                version=PROTOCOL_VERSION,
                capabilities=(LEAVING, NAMESAKES, SILENCE, PLACES),
                pid=os.getpid(),
                program=_program(),
                release=RELEASE,
                clock_ns=monotonic_offset_ns(),
            )
        )
        self._requests[0] = _Request(self._greeted, monotonic_ns())
        self._watch_in(min(TELL_S, ANSWER_S))
        try:
            hello = await self._greeted
        except TimeoutError:
            raise BrokerUnavailable(no_answer(path, ANSWER_S)) from None
        except ConnectionClosed:
            raise self._refusal(path) from None
        finally:
            self._requests.pop(0, None)
            if not self._greeted.done() or self._greeted.cancelled() or self._greeted.exception():
                self.close()
        if self._stream is None:  # its last word came right behind its Hello
            raise self._refusal(path)
        self.hello = hello

    def _refusal(self, path: str) -> BrokerUnavailable:
        """The error for a connection that has ended before it could be used."""
        if self._was_silent:  # so does a broker that ends with connections in its backlog
            return NotNow(f"busd at {path} closed the connection without a word")
        kind = NotNow if self._is_for_now else BrokerUnavailable
        return kind(f"busd at {path} refused this process: {self._loss}")

    def send(self, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """Send a control message, or a frame in turn with these; does nothing once the connection has
        ended."""
        if self._stream is not None:
            self.outbox.put(message if isinstance(message, bytes) else m.encode_frame(message), descriptors)
            self._stream.flush()

    @property
    def is_quiet(self) -> bool:
        """Whether all that has come was read."""
        return self._stream is None or self._stream.is_quiet

    def share(self) -> None:
        """Before an endpoint is declared: send how to wake this process, once for each connection."""
        if self._shm_context is not None and not self._has_shared:
            self._has_shared = True
            self.send(m.Share(), (self._shm_context.doorbell, self._shm_context.segment))

    @property
    def is_writing(self) -> bool:
        """Whether the socket has yet to take some of what was chosen for it."""
        return self._stream is not None and self._stream.is_blocked

    def flush(self) -> None:
        """Send what waits, as far as the socket takes it."""
        if self._stream is not None:
            self._stream.flush()

    def send_now(self, frame: Buffer) -> bool:
        """Send a data frame at once, where nothing waits to be sent; returns whether it was."""
        return self._stream is not None and self._stream.send_now(frame)

    async def request(
        self, number: int, message: m.Message, kind: type[A], descriptors: tuple[Descriptor, ...] = ()
    ) -> A:
        """Send `message`, the request `number` (of `numbers`); returns the answer, which is a `kind`.

        Raises ConfigurationError, QuotaExceeded or AccessDenied where the broker refuses, TimeoutError where
        it says nothing at all for ANSWER_S, RemoteProtocolError where it answers something else,
        ConnectionClosed where the connection ends first.
        """
        if self._stream is None:
            raise ConnectionClosed("the connection to busd is closed")
        answer = self._loop.create_future()
        self._requests[number] = _Request(answer, monotonic_ns())
        try:
            self.send(message, descriptors)
            if self._watch is None and self._stream is not None:
                self._watch_in(min(TELL_S, ANSWER_S))
            return expect(await answer, kind)
        finally:
            self._requests.pop(number, None)

    def _watch_in(self, time_s: float) -> None:
        """Look then whether answers are late. All share one timer: most answers come long before it."""
        self._watch_ns = monotonic_ns() + int(time_s * 1e9)
        self._watch = self._loop.call_later(time_s, self._look_for_late)

    def _look_for_late(self) -> None:
        """End the waits for answers where the broker has said nothing at all for ANSWER_S.

        A broker that is only busy says something meanwhile, and is not given up. After TELL_S the log says
        that this process waits.
        """
        self._watch = None
        now_ns = monotonic_ns()
        if now_ns - self._watch_ns > _LATE_NS:
            self._stood_still_ns = now_ns
        heard_ns = max(self.heard_ns, self._stood_still_ns)
        due_s = []
        longest_s = 0.0
        for request in self._requests.values():
            left_s = ANSWER_S - (now_ns - max(request.since_ns, heard_ns)) / 1e9
            if request.answer.done():
                continue
            longest_s = max(longest_s, ANSWER_S - left_s)
            if left_s > 0:
                tell_s = left_s - ANSWER_S + TELL_S
                due_s.append(tell_s if 0 < tell_s < left_s else left_s)
            elif self.is_quiet:
                request.answer.set_exception(TimeoutError(no_answer(self._path, ANSWER_S)))
            else:
                due_s.append(_UNREAD_S)
        is_news = not self._told_ns or self._told_ns < self.heard_ns
        if is_news and due_s and longest_s >= TELL_S and self.is_quiet:
            self._told_ns = now_ns
            _log.warning(no_answer_yet(self._path))
        if due_s:
            self._watch_in(min(due_s))

    def declare_type(self, support: TypeSupport[Any]) -> None:
        """Make a message type known, once for each connection.

        Raises ConfigurationError where its schema is longer than any busd would read.
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
        """Perhaps busd has not taken it: say it again with the next endpoint."""
        self._types.discard((support.name, support.hash))

    def resolve(self, message: Any) -> bool:
        """Handle what concerns the connection itself; returns whether it did.

        Raises RemoteProtocolError for the broker's last word.
        """
        match message:
            case m.Hello():
                if not self._greeted.done():
                    self._greeted.set_result(message)
            case m.Ping(number=number):
                self.send(m.Pong(number=number))
            case m.Pong():
                pass
            case m.Fault(text=text):
                self._is_for_now = message.again
                raise RemoteProtocolError(text)
            case m.Leaving(text=text):
                self._farewell = text
                if self._stream is not None:
                    self._stream.finish()
            case m.Refused() | m.Created() | m.Done() | m.TypeDescription() | m.GraphSnapshot():
                request = self._requests.get(message.request)
                if request is not None and not request.answer.done():
                    request.answer.set_result(message)
            case _:
                return False
        return True

    def beat(self, interval_s: float) -> None:
        """Send a sign of life every `interval_s` seconds from now on."""
        if self._heartbeat is not None:
            self._heartbeat.cancel()
        if self._stream is not None:
            self._beat_ns = monotonic_ns()
            self._due_ns = self._beat_ns + int(interval_s * 1e9)
            self.late_ns = self._due_ns + _LATE_NS
            self._heartbeat = self._loop.call_later(interval_s, self._beat, interval_s)

    def note_standstill(self, now_ns: int) -> None:
        """The event loop stood still. If for longer than the lease, warn here: the fault is this
        program's."""
        self.late_ns = _NEVER_NS
        most_s = (now_ns - self._beat_ns) / 1e9
        if most_s < self.hello.lease_s or (isinstance(self._loop, GuardedLoop) and self._loop.rests):
            return
        if (turn_ns := max(self.turn_ns, self.heard_ns)) > self._beat_ns:
            time = f"{(now_ns - turn_ns) / 1e9:.0f} s"
        else:
            least, most = f"{(now_ns - self._due_ns) / 1e9:.0f}", f"{most_s:.0f}"
            time = f"{most} s" if least == most else f"{least} to {most} s"
        _log.warning(f"this program's event loop stood still for {time}: what waited for it has gone on")

    def close(self) -> None:
        """Send what the socket still takes, and end."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()
        self._finish(ConnectionClosed("the connection to busd is closed"))

    def abandon(self) -> None:
        """In the child of a fork: let go of what is the parent's, so that its end ends the connection."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.abandon()

    def _beat(self, interval_s: float) -> None:
        if (now_ns := monotonic_ns()) > self.late_ns:
            self.note_standstill(now_ns)
        self.send(m.Ping())
        self.beat(interval_s)

    def _lost(self, error: Exception | None) -> None:
        why = str(error) if error else self._farewell or "busd closed the connection"
        reason = self._loss = ConnectionClosed(why)
        self._was_silent = not isinstance(error, RemoteProtocolError)
        self._stream = None
        self._finish(reason)
        self._on_lost(reason)

    def _finish(self, reason: BusError) -> None:
        for timer in (self._heartbeat, self._watch):
            if timer is not None:
                timer.cancel()
        waits = [*(request.answer for request in self._requests.values()), self._greeted]
        for waiting in waits:
            if not waiting.done():
                waiting.set_exception(reason)
        # Perhaps no call waits any more: asyncio must not report the error as one that was never retrieved.
        for waiting in waits:
            if not waiting.cancelled():
                waiting.exception()
        self._requests.clear()


def _program() -> str:
    return sys.argv[0].rpartition("/")[2][:255] if sys.argv and sys.argv[0] else "python"

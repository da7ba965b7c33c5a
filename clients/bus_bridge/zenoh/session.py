"""zenoh's session: everything used of the package `zenoh`, including functions that it calls unstable.

zenoh calls back in its own threads. They put data into a `Source`, and the event loop takes it from there.
Declarations wait for room in the link, so a thread of the bridge makes them, one by one and in order. The
loop itself only calls `put` and `reply`: with congestion control DROP they hardly wait.
"""

import asyncio
import json
import os
import queue
import resource
import secrets
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Generic, NamedTuple, TypeVar

import zenoh
from zenoh.handlers import Callback

from bus import shm
from bus.transport.memory import keep_freed_memory
from bus_bridge.engine import Priority
from bus_bridge.errors import BridgeError
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.sockets import give_up_in_time

__all__ = ["PRIORITIES", "Declared", "Link", "Outlet", "Query", "Session", "Source"]

_T = TypeVar("_T")

_THREADS = "(rx: (worker_threads: 1), acc: (handover: rx))"
"""Settings that zenoh reads once, from its environment. By default, the system notifies one thread of
input, which wakes one of two other threads to read it. With this setting, it reads itself on accepted links:
Python could not run two threads at a time anyway."""
_LEASE_MS = 10_000
_RETRY = {"period_init_ms": 500, "period_max_ms": 1000, "period_increase_factor": 2}
_OPEN_MS = 4000  # then try again: TCP's pauses grow, and the cable may be back earlier
_QUEUE_BATCHES = 16  # of 64 KiB, for each priority of each link: the most that zenoh has
_WAIT_BEFORE_DROP_US = 1000
_MAX_MESSAGE_BYTES = 4 << 20  # busd sends larger messages in pieces, and descriptions of types are smaller
_MAX_QUESTION_BYTES = 64
_LEAST_DESCRIPTORS = 64
_ROUTER_S = 0.5  # zenoh opens a client only with a router; a short timeout reports errors in options sooner
_AT_ONCE = 64  # items that one source passes on in a turn of the loop
PRIORITIES: dict[Priority, Any] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive_low": zenoh.Priority.INTERACTIVE_LOW,
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data_low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}
_OVERTAKING = zenoh.Priority.INTERACTIVE_HIGH  # control messages overtake the data that waits for them


class Link(NamedTuple):
    zenoh_id: str
    """The zenoh id of the session at the other end."""
    src: str
    dst: str

    @property
    def silent_host(self) -> str:
        """The host at the other end, if the end of a killed process there would be noticed late (QUIC);
        otherwise ""."""
        protocol, _, place = self.dst.partition("/")
        return place.rpartition(":")[0] if protocol == "quic" else ""


class Source(Generic[_T]):
    """A queue from zenoh's threads to the loop: `push` in any thread, `take` on the loop.

    `bound` has the unit of the sizes given to `push`. At the limit, the oldest item goes to `on_lost` (in
    zenoh's thread), or the new one with `keeps_oldest`.
    """

    def __init__(
        self,
        inbox: "_Inbox",
        take: Callable[[_T], None],
        bound: int,
        on_lost: Callable[[_T], None],
        *,
        keeps_oldest: bool = False,
        after: Callable[[], None] | None = None,
    ) -> None:
        self._inbox = inbox
        self._take = take
        self._bound = bound
        self._on_lost = on_lost
        self._keeps_oldest = keeps_oldest
        self._after = after
        self._things: deque[tuple[_T, int]] = deque()
        self._put_in, self._taken_out = 0, 0  # only one side writes each of them
        self._discarded = 0
        self.is_due = False
        self.is_closed = False

    @property
    def is_empty(self) -> bool:
        """Whether `take` has got all items so far."""
        return not self._things

    def push(self, thing: _T, size: int = 1) -> None:
        if self._put_in - self._taken_out - self._discarded + size > self._bound and self._things:
            if self._keeps_oldest:
                self._on_lost(thing)
                return
            with suppress(IndexError):  # the loop was quicker
                lost, lost_size = self._things.popleft()
                self._discarded += lost_size
                self._on_lost(lost)
        self._things.append((thing, size))
        self._put_in += size
        if not self.is_due:
            self.is_due = True
            self._inbox.wake(self)

    def drain(self) -> None:
        self.is_due = False  # clear it first: a later push has to wake the loop again
        things, left = self._things, _AT_ONCE
        while left and not self.is_closed:
            try:
                thing, size = things.popleft()
            except IndexError:
                break
            self._taken_out += size
            self._take(thing)
            left -= 1
        if self._after is not None and not self.is_closed:
            self._after()
        if not left:
            self.wake_again()

    def wake_again(self) -> None:
        """Continue with the remaining items in another turn."""
        if self._things and not self.is_due:
            self.is_due = True
            self._inbox.wake(self)

    def close(self) -> None:
        self.is_closed = True
        self._things.clear()


class _Inbox:
    """Wakes the loop once, however many items come before it runs. It uses its own eventfd, because
    `call_soon_threadsafe` takes 7 us longer."""

    def __init__(self, loop: asyncio.AbstractEventLoop, on_fault: Callable[[Exception], None]) -> None:
        self._loop = loop
        self._on_fault = on_fault
        self._due: deque[Source[Any]] = deque()
        self._is_awake = False
        self._bell: int | None = None
        self._ringing = threading.Lock()  # else another file may have the number of a closed one

    def open(self) -> None:
        self._bell = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._loop.add_reader(self._bell, self._drain, self._bell)

    def wake(self, source: Source[Any]) -> None:
        self._due.append(source)
        if not self._is_awake:
            self._is_awake = True
            with self._ringing:
                if self._bell is not None:
                    os.eventfd_write(self._bell, 1)

    def close(self) -> None:
        """Stop waking the loop."""
        with self._ringing:
            bell, self._bell = self._bell, None
        if bell is not None:
            self._loop.remove_reader(bell)
            os.close(bell)

    def _drain(self, bell: int) -> None:
        os.eventfd_read(bell)
        self._is_awake = False
        for _ in range(len(self._due)):
            source = self._due.popleft()
            try:
                source.drain()
            except Exception as error:  # input of one far side must not end the work of others
                self._on_fault(error)
                source.wake_again()


class Declared:
    """Something that a session declares, now or in a moment. It is undeclared when no reference to it is
    left."""

    def __init__(self, session: "Session", declare: Callable[[], Any]) -> None:
        self._session = session
        self._declare = declare
        self._entity: Any = None
        self._is_gone = False
        session.do(self._make)

    def undeclare(self) -> None:
        """Undeclare it; one call is enough. zenoh may still call back afterwards."""
        self._is_gone = True
        self._session.do(self._end)

    def renew(self) -> None:
        """Declare it once more, and undeclare the former one after that."""
        self._session.do(self._make_again)

    def _make(self) -> None:
        if not self._is_gone:
            self._entity = self._declare()

    def _make_again(self) -> None:
        if not self._is_gone:
            former, self._entity = self._entity, self._declare()
            if former is not None:
                former.undeclare()

    def _end(self) -> None:
        entity, self._entity = self._entity, None
        if entity is not None:
            entity.undeclare()


class Outlet(Declared):
    """A zenoh publisher. `on_ready` is called when it is usable."""

    def __init__(
        self, session: "Session", key: str, priority: Priority, on_ready: Callable[[], None]
    ) -> None:
        self.put: Any = None
        """None until it is usable."""
        self._on_ready = on_ready
        super().__init__(session, lambda: session.declare_publisher(key, priority))

    def _make(self) -> None:
        super()._make()
        if self._entity is not None:
            self._session.call(self._ready)

    def _ready(self) -> None:
        if self._entity is not None:
            self.put = self._entity.put
            self._on_ready()


class Query:
    """A question of another bridge. Answer it once, on the loop."""

    def __init__(self, query: Any) -> None:
        self._query = query
        self.key = str(query.key_expr)
        asked = query.payload
        self.payload: bytes = b"" if asked is None or len(asked) > _MAX_QUESTION_BYTES else asked.to_bytes()

    def reply(self, payload: bytes, attachment: bytes | None = None) -> None:
        with suppress(zenoh.ZError):  # the other side has gone
            self._query.reply(self.key, payload, attachment=attachment)
        self.drop()

    def drop(self) -> None:
        """Send no answer."""
        self._query.drop()


class Session:
    """A session without scouting, only with the links in `options`. With a router it is the router's client,
    otherwise a peer."""

    def __init__(
        self,
        options: ZenohOptions,
        on_fault: Callable[[Exception], None],
        settings: Mapping[str, object] | None = None,
    ) -> None:
        """`on_fault` is called on the loop with an exception raised by our code in a callback: a bug in the
        bridge. `settings` of zenoh replace those made from the options."""
        self.zenoh_id = f"f{secrets.token_hex(15)}"  # known before there is a router
        self._config = _config(options, self.zenoh_id, settings or {})
        self._on_fault = on_fault
        self._options = options
        self._loop = asyncio.get_running_loop()
        self._inbox = _Inbox(self._loop, on_fault)
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._zenoh: Any = None
        self._links: dict[tuple[str, str, str], Link] = {}
        self.link_ends = 0
        """Number of links that have ended."""

    async def open(self) -> None:
        """Open the session. If there is no router yet, the session starts without one; declarations wait for
        it.

        Raises BridgeError. Cancellation: closed.
        """
        descriptors = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        if 0 <= descriptors < _LEAST_DESCRIPTORS:  # zenoh aborts a process with too few descriptors
            raise BridgeError(
                f"this program may open {descriptors} files (ulimit -n); zenoh needs {_LEAST_DESCRIPTORS}"
            )
        os.environ.setdefault("ZENOH_RUNTIME", _THREADS)
        keep_freed_memory()  # zenoh allocates and frees much memory with each message
        opened: asyncio.Future[None] = self._loop.create_future()
        self._inbox.open()
        try:
            threading.Thread(target=self._work, name="bus_bridge zenoh", daemon=True).start()
        except RuntimeError as error:
            self._inbox.close()
            raise BridgeError(f"zenoh can't start its thread: {error}") from None
        self._jobs.put(lambda: self._open(opened))
        try:
            if self._options.router:
                await asyncio.wait((opened,), timeout=_ROUTER_S)
            if opened.done() or not self._options.router:
                await opened
        except BaseException:
            self._jobs.put(self._close)
            self._jobs.put(None)
            self._inbox.close()
            raise

    async def close(self) -> None:
        """Close the session and everything declared in it. Cancellation: its thread completes the rest."""
        self._inbox.close()
        closed: asyncio.Future[None] = self._loop.create_future()
        self._jobs.put(self._close)
        self._jobs.put(lambda: self.call(_settle, closed))
        self._jobs.put(None)
        await closed

    # --- declarations

    def token(self, key: str) -> Declared:
        return Declared(self, lambda: self._zenoh.liveliness().declare_token(key))

    def watch_tokens(self, keys: str, source: Source[tuple[str, bool]]) -> Declared:
        """Watch tokens: `source` gets each token, and whether it has come or gone."""

        def see(sample: Any) -> None:
            source.push((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        return Declared(
            self,
            lambda: self._zenoh.liveliness().declare_subscriber(keys, _direct(see), history=True),
        )

    def subscribe(self, key: str, push: Callable[[Any, bytes, bytes | None], None]) -> Declared:
        """Subscribe: zenoh's thread calls `push` with each put's key (an object; str() gives the text),
        payload and attachment."""
        # Otherwise Python makes a new thread state for zenoh's thread for each part, which costs a seventh
        # more in all.
        keep_thread = shm.native.keep_thread if shm.has_core() else None

        def see(sample: Any) -> None:
            if keep_thread is not None:
                keep_thread()
            attachment = sample.attachment
            push(
                sample.key_expr,
                sample.payload.to_bytes(),
                None if attachment is None else attachment.to_bytes(),
            )

        return Declared(self, lambda: self._zenoh.declare_subscriber(key, _direct(see)))

    def answer(self, keys: str, source: Source[Query]) -> Declared:
        """Answer questions for `keys`: `source` gets each of them."""
        return Declared(
            self,
            lambda: self._zenoh.declare_queryable(keys, _direct(lambda query: source.push(Query(query)))),
        )

    def outlet(self, key: str, priority: Priority, on_ready: Callable[[], None]) -> Outlet:
        return Outlet(self, key, priority, on_ready)

    def declare_publisher(self, key: str, priority: Priority) -> Any:
        return self._zenoh.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=PRIORITIES[priority],
            express=True,  # batches are packed already: to wait for more messages costs about 70 us
            allowed_destination=zenoh.Locality.REMOTE,
        )

    # --- messages

    def put(self, key: str, payload: bytes) -> None:
        """Send a small payload, which may be lost."""
        with suppress(zenoh.ZError):
            self._zenoh.put(
                key,
                payload,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=_OVERTAKING,
                express=True,
                allowed_destination=zenoh.Locality.REMOTE,
            )

    def ask(
        self,
        key: str,
        payload: bytes,
        timeout_s: float,
        on_answer: Callable[[bytes | None, bytes | None], None],
    ) -> None:
        """Ask once, on the loop. The result is the payload and the attachment of the first answer; None
        without an answer."""
        answers: list[tuple[bytes, bytes | None]] = []

        def on_reply(reply: Any) -> None:
            if not answers and (sample := reply.ok) is not None:
                attachment = sample.attachment
                answers.append(
                    (sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes())
                )

        def end() -> None:
            self.call(on_answer, *(answers[0] if answers else (None, None)))

        def ask() -> None:
            try:
                self._zenoh.get(
                    key,
                    Callback(on_reply, end, indirect=False),
                    payload=payload,
                    timeout=timeout_s,
                    priority=_OVERTAKING,  # also the priority of the answer
                    congestion_control=zenoh.CongestionControl.DROP,
                    allowed_destination=zenoh.Locality.REMOTE,
                    consolidation=zenoh.ConsolidationMode.NONE,
                )
            except zenoh.ZError:
                end()

        self.do(ask)

    # --- links

    def links(self) -> list[Link]:
        """The present links."""
        return list(self._links.values())

    def routers(self) -> set[str]:
        """The zenoh ids of routers at the other ends of links."""
        return set() if self._zenoh is None else {str(one) for one in self._zenoh.info.routers_zid()}

    def _see_link(self, event: Any) -> None:  # in zenoh's thread
        link = event.link
        found = Link(str(link.zid), str(link.src), str(link.dst))
        if event.kind == zenoh.SampleKind.PUT:
            give_up_in_time(_LEASE_MS)
            self._links[found] = found
        else:
            self._links.pop(found, None)
            self.link_ends += 1

    # --- threads

    def source(
        self,
        take: Callable[[_T], None],
        bound: int,
        on_lost: Callable[[_T], None],
        *,
        keeps_oldest: bool = False,
        after: Callable[[], None] | None = None,
    ) -> Source[_T]:
        return Source(self._inbox, take, bound, on_lost, keeps_oldest=keeps_oldest, after=after)

    def call(self, what: Callable[..., None], *arguments: Any) -> None:
        """Call `what` on the loop, soon; may be used in any thread."""
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(what, *arguments)

    def do(self, job: Callable[[], None]) -> None:
        """Run `job` in the thread for declarations, after all earlier jobs."""
        self._jobs.put(job)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except zenoh.ZError:
                pass  # the session is closed
            except Exception as error:
                self.call(self._on_fault, error)

    def _open(self, opened: "asyncio.Future[None]") -> None:
        try:
            self._zenoh = zenoh.open(self._config)
            self._zenoh.info.declare_link_events_listener(_direct(self._see_link), history=True)
        except zenoh.ZError as error:
            self.call(_settle, opened, _explain(error, self._options))
        else:
            self.call(_settle, opened)

    def _close(self) -> None:
        if self._zenoh is not None:
            self._zenoh.close()


def _direct(callback: Callable[[Any], None]) -> Any:
    # Call back in zenoh's own thread: with `indirect`, each subscriber would have a separate thread.
    return Callback(callback, indirect=False)


def _settle(future: "asyncio.Future[None]", error: BridgeError | None = None) -> None:
    if future.done():
        return
    if error is None:
        future.set_result(None)
    else:
        future.set_exception(error)


def _config(options: ZenohOptions, zenoh_id: str, more: Mapping[str, object]) -> Any:
    settings: dict[str, object] = {
        "id": zenoh_id,
        "mode": "client" if options.router else "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": list(options.listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(options.router or options.connect),
        "connect/exit_on_failure": False,
        "connect/timeout_ms": -1,
        "connect/retry": _RETRY,
        "timestamping/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": _OPEN_MS,
        "transport/unicast/compression/enabled": options.compression,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _WAIT_BEFORE_DROP_US,
        "transport/link/rx/max_message_size": _MAX_MESSAGE_BYTES,
    }
    for priority in ("control", *PRIORITIES):
        settings[f"transport/link/tx/queue/size/{priority}"] = _QUEUE_BATCHES
    if options.certificate:
        tls = "transport/link/tls"
        settings |= {
            f"{tls}/root_ca_certificate": options.ca,
            f"{tls}/enable_mtls": True,
            f"{tls}/listen_private_key": options.key,
            f"{tls}/listen_certificate": options.certificate,
            f"{tls}/connect_private_key": options.key,
            f"{tls}/connect_certificate": options.certificate,
        }
    config = zenoh.Config()
    for name, value in {**settings, **more}.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _explain(error: Exception, options: ZenohOptions) -> BridgeError:
    text = str(error)
    where = ", ".join(options.listen)
    for known in ("Address already in use", "Cannot assign requested address", "Permission denied"):
        if known in text:
            return BridgeError(f"can't listen on {where}: {known.lower()}")
    return BridgeError(f"zenoh can't be opened: {text.partition(' at ')[0]}")

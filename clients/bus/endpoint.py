"""What publishers and subscriptions have in common: identity, declaration, matches, events, closing.

An endpoint sends through the link. The link calls the methods with an underscore that `bus.link.declarations`
lists.
"""

import asyncio
import os
from collections.abc import Callable, Mapping
from itertools import count
from time import monotonic_ns
from typing import Any, Generic, TypeVar

import msgspec

from bus.base.awaited import done_anyway
from bus.base.descriptor import Descriptor
from bus.diagnostics.provoked import is_worth_asking, warn
from bus.errors import BusError, ConfigurationError, ConnectionClosed, again
from bus.events import (
    DeadlineMissed,
    IncompatibleQoS,
    IncompatibleType,
    MatchedChange,
    PublisherEvents,
    SubscriptionEvents,
)
from bus.link.link import Link
from bus.logger import Logger
from bus.names import service_of_topic
from bus.qos import QoSProfile, in_words
from bus.schema import MessageSchema, schema_of
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.layout import ACCESS
from bus.wire.runs import Run

M = TypeVar("M", bound=msgspec.Struct)

GID_BYTES = 16
_process_prefix = os.urandom(12)
_gid_numbers = count(1)


def _forget_prefix() -> None:
    global _process_prefix
    _process_prefix = os.urandom(12)


os.register_at_fork(after_in_child=_forget_prefix)


class Match(msgspec.Struct, frozen=True):
    """The other side of a match of a publisher or subscription.

    For example:

        print([match.node for match in publisher.matches])
    """

    node: str
    """Its node's full name."""
    gid: bytes
    """Its gid, 16 bytes that no other endpoint has."""
    qos: QoSProfile
    """Its QoS."""
    route: str
    """How messages travel: `shm` or `socket`; `bridge` where the subscription is on another bus."""


class NodeContext(msgspec.Struct, frozen=True):
    """What endpoints, services and clients know of the node that makes them."""

    link: Link
    name: str
    """The node's full name."""
    logger: Logger
    on_error: Callable[[BaseException], None]
    """Called with what a callback raises."""


class Endpoint(Generic[M]):
    """Base of Publisher and Subscription; not made by users."""

    _kind = ""

    def __init__(
        self,
        node: NodeContext,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: PublisherEvents | SubscriptionEvents,
        gid: bytes | None = None,
    ) -> None:
        if gid is not None and len(gid) != GID_BYTES:
            raise ConfigurationError(f"gid {gid.hex()} of {len(gid)} bytes, a gid has {GID_BYTES}")
        self.topic_name = topic
        """The topic's full name."""
        self.node_name: str = node.name
        """The full name of its node."""
        self.type: type[M] = support.cls
        """The message class; `bytes` where messages stay encoded because there is none."""
        self.qos = qos
        """The policies that it was made with."""
        self._own_gid = _process_prefix + next(_gid_numbers).to_bytes(4, "big")
        self.gid: bytes = self._own_gid if gid is None else gid
        """16 bytes that no other endpoint has, on this machine or in another run."""
        self._support = support
        self._id = 0  # the broker's number, another one after a reconnection
        self._refusal: BusError | None = None  # why it cannot be used any more
        self._link = node.link
        self._on_error = node.on_error
        self._logger = node.logger
        self._events: Any = events
        self._matches: dict[int, Match] = {}
        self._taps: dict[int, Match] = {}
        self._besides: m.Report | None = None
        self._total_matches = 0
        self._incompatible_qos = 0
        self._incompatible_types = 0
        self._missed_deadlines = 0
        self._match_waiters: list[tuple[int, asyncio.Future[None]]] = []
        self._deadline: asyncio.TimerHandle | None = None
        self._last_ns = 0
        self._explaining: set[asyncio.Task[None]] = set()

    def __repr__(self) -> str:
        kind, qos = type(self).__name__, in_words(self.qos)
        return f"<{kind} {self._state()}{self.topic_name} {self._support.name} ({qos}) {self._counts()}>"

    @property
    def schema(self) -> MessageSchema:
        """Its type, as it is described on the bus."""
        return schema_of(self._support)

    @property
    def matches(self) -> tuple[Match, ...]:
        """The endpoints that this one is matched with now; none while busd is away, and once it is closed."""
        return tuple(self._matches.values())

    def report_besides(
        self, *, samples: int = 0, bytes: int = 0, dropped: Mapping[str, int] | None = None
    ) -> None:
        """Totals that are shown in the graph besides those that are counted here: for bridges, whose messages
        go other ways too.

        `samples` and their `bytes` crossed to the other bus; `dropped` by reason, a text of up to 32
        characters. Each call replaces what the one before said.
        """
        dropped = {reason: count for reason, count in (dropped or {}).items() if count}
        self._besides = m.Report(endpoint=0, samples=samples, bytes=bytes, dropped=dropped)
        self._link.report(self)

    @done_anyway
    async def close(self) -> None:
        """Leave the graph, a publisher after it has handed over what was published. Closing twice is allowed.

        Handing over takes 5 s at most; the log says what was lost. Calls that wait here raise
        ConnectionClosed. Cancellation: closed, and what was not handed over is lost.
        """
        if self._refusal is None:
            try:
                await self._drain()
            finally:
                self._link.forget(self)
                service = service_of_topic(self.topic_name)
                what = (
                    f"{self._kind} on '{self.topic_name}'"
                    if service is None
                    else f"end of service '{service}'"
                )
                self._end(ConnectionClosed(f"this {what} is closed"))

    def _end(self, reason: BusError) -> None:
        """The endpoint can't be used any more; calls that wait raise `reason`."""
        self._refusal = reason.with_traceback(None)  # its frames would hold descriptors open
        if self._deadline is not None:
            self._deadline.cancel()
        for task in self._explaining:
            task.cancel()
        for _, waiter in self._match_waiters:
            if not waiter.done():
                waiter.set_exception(reason)
        self._match_waiters.clear()
        self._matches.clear()
        self._taps.clear()

    def _abandon(self, reason: BusError) -> None:
        """In the child of a fork: not to be used any more; nothing of the parent's loop is touched."""
        self._refusal = reason

    def _declaration(self, request: int, node: int) -> m.Message:
        """The message that creates this endpoint at the broker."""
        raise NotImplementedError

    def _declared(self, answer: m.Created) -> None:
        """The broker knows this endpoint now, for the first time or again."""
        self._id = answer.id
        if self._besides is not None:
            self._link.report(self)

    def _disconnected(self) -> None:
        """The broker is gone: so are the matches, until it is back."""
        for other in (*self._matches, *self._taps):
            self._unmatch(other)

    def _hand_over(self) -> None:
        """Turn what was gathered into a run (a publisher's part)."""

    _receive_lone: Callable[[Run], bool] = staticmethod(lambda run: False)
    """Deliver a run that came alone, by the quick way; False where nothing was done."""

    def _receive_run(self, run: Run) -> None:
        """A run has come (a subscription's part)."""

    def _wake(self) -> None:
        """All that was read has been handed out (a subscription's part)."""

    def _totals(self) -> m.Report:
        """The counters, for the graph."""
        raise NotImplementedError

    @property
    def _shared(self) -> tuple[Descriptor, ...]:
        """Descriptors that go with the declaration."""
        return ()

    def _handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """A control message from the broker about this endpoint, and what came with it."""
        match message:
            case m.Matched():
                self._match(message)
            case m.Unmatched(other=other, lost=is_lost):
                self._unmatch(other, is_lost=is_lost)
            case m.Rerouted(other=other, route=route):
                for table in (self._matches, self._taps):
                    if other in table:
                        table[other] = msgspec.structs.replace(table[other], route=route)
            case m.Incompatible(type_hash=type_hash) if type_hash and is_worth_asking():
                self._explaining.add(self._link.loop.create_task(self._explain(message)))
            case m.Incompatible():
                self._report_incompatible(message)

    def _state(self) -> str:
        """For `repr`, where it can't be used, or not now."""
        if self._refusal is not None:
            kind = type(self._refusal)
            return "closed " if kind is ConnectionClosed else f"ended by {kind.__name__} "
        return "" if self._id else "not connected "

    def _counts(self) -> str:
        """For `repr`, at any time and from any thread."""
        raise NotImplementedError

    async def _wait_for_matches(self, number: int) -> None:
        if self._refusal is not None:
            raise again(self._refusal)
        if self._ready_matches() >= number:
            return
        waiter = asyncio.get_running_loop().create_future()
        entry = (number, waiter)
        self._match_waiters.append(entry)
        try:
            await waiter
        finally:
            if entry in self._match_waiters:
                self._match_waiters.remove(entry)

    async def _drain(self) -> None:
        """Wait until nothing is left to be handed over."""

    def _match(self, message: m.Matched) -> None:
        match = Match(message.node, message.stands_for or message.gid, message.qos, message.route)
        if message.is_tap:
            self._taps[message.other] = match
            return
        self._matches[message.other] = match
        self._total_matches += 1
        self._release_match_waiters()
        self._tell_match(1, message.node)

    def _ready_matches(self) -> int:
        """Matches by which a message would arrive at once."""
        return len(self._matches)

    def _release_match_waiters(self) -> None:
        for number, waiter in self._match_waiters:
            if self._ready_matches() >= number and not waiter.done():
                waiter.set_result(None)

    def _unmatch(self, other: int, *, is_lost: bool = False) -> None:
        self._taps.pop(other, None)
        gone = self._matches.pop(other, None)
        if gone is not None:
            self._tell_match(-1, gone.node)

    def _tell_match(self, change: int, node: str) -> None:
        event = MatchedChange(len(self._matches), change, self._total_matches, max(change, 0), node)
        self._tell(self._events.matched, event)

    async def _explain(self, message: m.Incompatible) -> None:
        """Say where the two definitions of the type differ, not only that they do."""
        from bus.types.diff import difference

        task = asyncio.current_task()
        try:
            own = self._support.description
            other = await self._link.description(self._support.name, message.type_hash)
            found = difference(own, other) if self._kind == "publisher" else difference(other, own)
        except (BusError, TimeoutError):
            found = None  # the other has left already: then the hashes must do
        finally:
            assert task is not None
            self._explaining.discard(task)
        if found is not None:
            text = f"both call it {self._support.name}, but {found}"
            message = msgspec.structs.replace(message, text=text)
        self._report_incompatible(message)

    def _report_incompatible(self, message: m.Incompatible) -> None:
        if message.policy == ACCESS:  # no event of ROS 2's: the other is not there
            text = f"node {message.node} was denied access to '{self.topic_name}': {message.text}"
            warn(self._logger, text)
            return
        if message.policy == "TYPE":
            self._incompatible_types += 1
            event: Any = IncompatibleType(self._incompatible_types, 1, message.text, message.node)
            callback: Callable[[Any], object] | None = self._events.incompatible_type
            text = self._type_warning()
        else:
            self._incompatible_qos += 1
            event = IncompatibleQoS(self._incompatible_qos, 1, message.policy, message.text, message.node)
            callback = self._events.incompatible_qos
            text = self._qos_warning(message.policy)
        if callback is not None:
            self._tell(callback, event)
        else:
            warn(self._logger, f"{text} (node {message.node}: {message.text.rstrip(';')})")

    def _type_warning(self) -> str:
        raise NotImplementedError

    def _qos_warning(self, policy: str) -> str:
        raise NotImplementedError

    def _watch_deadline(self) -> None:
        """Start to look for gaps longer than the QoS deadline, which there is."""
        if self._deadline is None:
            self._last_ns = monotonic_ns()
            self._arm_deadline()

    def _arm_deadline(self) -> None:
        due_ns = self._last_ns + self.qos.deadline_ns - monotonic_ns()
        self._deadline = self._link.later(max(due_ns, 0) / 1e9, self._check_deadline)

    def _check_deadline(self) -> None:
        now_ns = monotonic_ns()
        if now_ns - self._last_ns >= self.qos.deadline_ns:
            self._last_ns = now_ns
            self._missed_deadlines += 1
            self._tell(self._events.deadline_missed, DeadlineMissed(self._missed_deadlines, 1))
        self._arm_deadline()

    def _tell(self, callback: Callable[[Any], object] | None, event: Any) -> None:
        if callback is not None:
            try:
                callback(event)
            except Exception as error:
                self._on_error(error)


def summed(one: Mapping[str, int], other: Mapping[str, int]) -> dict[str, int]:
    """By reason."""
    return {reason: one.get(reason, 0) + other.get(reason, 0) for reason in (*one, *other)}

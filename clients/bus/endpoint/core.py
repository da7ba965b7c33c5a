"""The internal part of a publisher or subscription, used by its link and delivery.

Owns its number at the broker, its matches, its control messages and its end. The user's object refers to the
core, and the core does not know the user's object.
"""

import os
from collections.abc import Callable, Mapping
from itertools import count
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import msgspec

from bus.base.descriptor import Descriptor
from bus.endpoint.matches import Match, Matches
from bus.errors import BusError, ConfigurationError, ConnectionClosed, again
from bus.events import DeadlineMissed, MatchedChange, PublisherEvents, SubscriptionEvents
from bus.link.link import Link
from bus.logger import Logger
from bus.names import service_of_topic
from bus.qos import QoSProfile
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.runs import Run

if TYPE_CHECKING:  # few endpoints need them
    from bus.endpoint.deadline import DeadlineWatch
    from bus.endpoint.incompatible import IncompatibleEndpoints

__all__ = ["EndpointCore", "NodeContext", "new_gid", "summed"]

M = TypeVar("M", bound=msgspec.Struct)

GID_BYTES = 16
_process_prefix = os.urandom(12)
_gid_numbers = count(1)


def _forget_prefix() -> None:
    global _process_prefix
    _process_prefix = os.urandom(12)


os.register_at_fork(after_in_child=_forget_prefix)


def new_gid() -> bytes:
    """Make 16 bytes that no other endpoint has, on this machine or in another run."""
    return _process_prefix + next(_gid_numbers).to_bytes(4, "big")


class NodeContext(msgspec.Struct, frozen=True):
    """The data of a node for its endpoints, services and clients."""

    link: Link
    name: str
    """The node's full name."""
    logger: Logger
    on_error: Callable[[BaseException], None]
    """Called with the exception of a callback."""


class EndpointCore(Generic[M]):
    """Base of PublisherCore and SubscriptionCore. `gid`: the gid of the endpoint that this one represents."""

    kind = ""
    consequence = ""
    """The consequence of an incompatible type for the messages, in a warning."""
    lease_s: float | None = None
    """Time within which the broker needs a sign of life, or None if it needs none."""

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
        self.support = support
        self.qos = qos
        self.gid = gid or _process_prefix + next(_gid_numbers).to_bytes(4, "big")
        self.node_name = node.name
        self.link = node.link
        self.logger = node.logger
        self.on_error = node.on_error
        self.events: Any = events
        self.id = 0
        """The broker's number, another one after a reconnection. 0: the broker does not know the endpoint
        now."""
        self.refusal: BusError | None = None
        """The error for all uses after the end."""
        self.matches = Matches()
        self.deadline: DeadlineWatch | None = None
        self._missed_deadlines = 0
        self.besides: m.Report | None = None
        """Counters reported in addition to the ones counted here."""
        self._incompatible: IncompatibleEndpoints | None = None

    # --- for the user's object

    def describe_state(self) -> str:
        """For `repr`, if it can't be used, or not now."""
        if self.refusal is not None:
            kind = type(self.refusal)
            return "closed " if kind is ConnectionClosed else f"ended by {kind.__name__} "
        return "" if self.id else "not connected "

    def report_besides(self, samples: int, size: int, dropped: Mapping[str, int]) -> None:
        """As `Endpoint.report_besides`."""
        dropped = {reason: count for reason, count in dropped.items() if count}
        self.besides = m.Report(endpoint=0, samples=samples, bytes=size, dropped=dropped)
        self.link.report(self)

    def statistics(self) -> Any:
        """As `statistics` of the user's object."""
        raise NotImplementedError

    async def wait_for_matches(self, number: int) -> None:
        if self.refusal is not None:
            raise again(self.refusal)
        await self.matches.wait(number, self.count_ready)

    def count_ready(self) -> int:
        """The number of matches over which a message would arrive at once."""
        return len(self.matches)

    async def close(self) -> None:
        """As `Endpoint.close`."""
        if self.refusal is None:
            reason = self._end_threads()
            try:
                await self.drain()
            finally:
                self._leave(reason)

    def close_at_once(self) -> bool:
        """Close, if everything was handed over already; returns whether it is closed."""
        if self.refusal is None:
            reason = self._end_threads()
            if self.is_drained:
                self._leave(reason)
        return self.refusal is not None

    @property
    def is_drained(self) -> bool:
        """Whether `drain` has nothing to wait for."""
        return True

    def refuse_threads(self, reason: BusError) -> None:
        """Raise `reason` for further messages of other threads (only publishers)."""

    async def drain(self) -> None:
        """Wait until everything was handed over."""

    # --- for the link

    def declaration(self, request: int, node: int) -> m.Message:
        """The message that creates this endpoint at the broker."""
        raise NotImplementedError

    @property
    def shared(self) -> tuple[Descriptor, ...]:
        """Descriptors to send with the declaration."""
        return ()

    def declared(self, answer: m.Created) -> None:
        """Note that the broker knows this endpoint now, for the first time or again."""
        self.id = answer.id
        if self.besides is not None:
            self.link.report(self)

    def disconnected(self) -> None:
        """Note that the broker is gone, with all matches, until it is back."""
        for other in (*self.matches, *self.matches.taps):
            self.remove_match(other)

    def hand_over(self) -> None:
        """End and send the open run (only publishers)."""

    receive_lone: Callable[[Run], bool] = staticmethod(lambda run: False)
    """Delivers the only run of a read, by the quick way; False if nothing was done."""

    def receive_run(self, run: Run) -> None:
        """Take a received run (only subscriptions)."""

    def wake(self) -> None:
        """Deliver, after all data of a read was distributed (only subscriptions)."""

    def totals(self) -> m.Report:
        """The counters, for the graph."""
        raise NotImplementedError

    def handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """Handle a control message from the broker about this endpoint, and its descriptors."""
        match message:
            case m.Matched():
                self.add_match(message)
            case m.Unmatched(other=other, lost=is_lost):
                self.remove_match(other, is_lost=is_lost)
            case m.Rerouted(other=other, route=route):
                self.matches.reroute(other, route)
            case m.Incompatible():
                if self._incompatible is None:
                    from bus.endpoint.incompatible import IncompatibleEndpoints

                    self._incompatible = IncompatibleEndpoints(self)
                self._incompatible.add(message)

    def end(self, reason: BusError) -> None:
        """End the endpoint; waiting calls raise `reason`."""
        self.refusal = reason.with_traceback(None)  # its frames would keep descriptors open
        if self.deadline is not None:
            self.deadline.end()
        if self._incompatible is not None:
            self._incompatible.end()
        self.matches.end(reason)

    def abandon(self, reason: BusError) -> None:
        """End in the child of a fork, without touching the parent's loop."""
        self.refusal = reason

    # --- for the two kinds

    def add_match(self, message: m.Matched) -> None:
        match = Match(message.node, message.stands_for or message.gid, message.qos, message.route)
        if message.is_tap:
            self.matches.taps[message.other] = match
            return
        self.matches[message.other] = match
        self.matches.total += 1
        self.matches.release(self.count_ready)
        self._report_match(1, message.node)

    def remove_match(self, other: int, *, is_lost: bool = False) -> None:
        self.matches.taps.pop(other, None)
        gone = self.matches.pop(other, None)
        if gone is not None:
            self._report_match(-1, gone.node)

    def notify(self, callback: Callable[[Any], object] | None, event: Any) -> None:
        """Call a user's callback for an event, if there is one."""
        if callback is not None:
            try:
                callback(event)
            except Exception as error:
                self.on_error(error)

    def describe_incompatible_qos(self) -> str:
        """The text of a warning: the incompatible endpoint, and the consequence for messages."""
        raise NotImplementedError

    def newest_ns(self) -> int:
        """Time of the newest message that the deadline watch has not been given."""
        raise NotImplementedError

    def watch_deadline(self) -> None:
        """Start to watch for gaps longer than the QoS deadline, which must be set."""
        if self.deadline is None:
            from bus.endpoint.deadline import DeadlineWatch

            self.deadline = DeadlineWatch(
                self.link, self.qos.deadline_ns, self.newest_ns, self._miss_deadline
            )

    def with_besides(self, report: m.Report, besides: m.Report) -> m.Report:
        """The sums of both reports."""
        return msgspec.structs.replace(
            report,
            samples=report.samples + besides.samples,
            bytes=report.bytes + besides.bytes,
            dropped=summed(report.dropped, besides.dropped),
        )

    def _end_threads(self) -> ConnectionClosed:
        """Raise the returned reason of the end in other threads, from now on."""
        service = service_of_topic(self.topic_name)
        what = f"{self.kind} on '{self.topic_name}'" if service is None else f"end of service '{service}'"
        reason = ConnectionClosed(f"this {what} is closed")
        self.refuse_threads(reason)
        return reason

    def _leave(self, reason: ConnectionClosed) -> None:
        self.link.forget(self)
        self.end(reason)

    def _report_match(self, change: int, node: str) -> None:
        event = MatchedChange(len(self.matches), change, self.matches.total, max(change, 0), node)
        self.notify(self.events.matched, event)

    def _miss_deadline(self) -> None:
        self._missed_deadlines += 1
        self.notify(self.events.deadline_missed, DeadlineMissed(self._missed_deadlines, 1))


def summed(one: Mapping[str, int], other: Mapping[str, int]) -> dict[str, int]:
    """The sums of both, by reason."""
    return {reason: one.get(reason, 0) + other.get(reason, 0) for reason in (*one, *other)}

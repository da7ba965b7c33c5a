"""The internal part of a publisher: its sender, and messages about its matches."""

import asyncio
import contextlib
from time import monotonic_ns
from typing import Any, TypeVar

import msgspec

from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.sender import Sender
from bus.delivery.shm_sender import ShmSender
from bus.endpoint.core import EndpointCore, NodeContext, new_gid
from bus.endpoint.matches import Match
from bus.errors import BusError, ConnectionClosed
from bus.events import LivelinessLost, PublisherEvents
from bus.qos import History, Liveliness, QoSProfile, check_offer
from bus.types.support import TypeSupport
from bus.vocabulary import DropReason, Route
from bus.wire import messages as m
from bus.wire.layout import MAX_MESSAGE_BYTES

__all__ = ["PublisherCore", "PublisherStatistics"]

M = TypeVar("M", bound=msgspec.Struct)

_DRAIN_S = 5.0


class PublisherStatistics(msgspec.Struct, frozen=True):
    """Totals of one publisher.

    For example:

        print(publisher.statistics().published)
    """

    published: int
    """Messages that `publish` accepted."""
    bytes: int
    """Their encoded size."""
    queued: int
    """Messages not yet handed over to busd."""
    replaced: int
    """Messages replaced before they were handed over, because of the depth or a bound of 64 MiB."""
    refused: int
    """Calls of `publish` that found no room (reliable + keep all)."""
    subscriptions: int
    """Subscriptions matched now."""
    at_ns: int = 0
    """Time of counting: nanoseconds of the monotonic clock (`time.monotonic_ns`)."""


class PublisherCore(EndpointCore[M]):
    """The core of one publisher. `sends` is the native core's part of `Publisher.send`, if there is one."""

    kind = "publisher"
    consequence = "no messages will be sent to it"

    def __init__(
        self,
        node: NodeContext,
        topic: str,
        support: TypeSupport[M],
        qos: QoSProfile,
        events: PublisherEvents,
        sends: "shm.native.Sends | None",
        *,
        by_socket: bool = False,
        gid: bytes | None = None,
    ) -> None:
        check_offer(qos)
        super().__init__(node, topic, support, qos, events, gid)
        self.max_bytes = MAX_MESSAGE_BYTES
        if qos.liveliness is Liveliness.AUTOMATIC:
            self.lease_s = qos.liveliness_lease_duration
        self.refused = 0
        """Calls that found no room, in addition to the sender's count."""
        self._own_gid = self.gid if gid is None else new_gid()
        self._lost_liveliness = 0
        ring = None if by_socket else ShmSender.make(node.link, self, node.logger)
        self.sender = Sender(node.link, self, node.logger, ring, sends)
        self.long_fields = support.bytes_fields
        """The fields that are copied separately from the rest of the message if they are long."""
        if sends is not None:  # without the core, a copy would join them with the rest
            self.long_fields += support.text_fields
        if qos.deadline is not None:
            self.watch_deadline()

    def statistics(self) -> PublisherStatistics:
        """As `Publisher.statistics`."""
        published, size = self.sender.published
        return PublisherStatistics(
            published=published,
            bytes=size,
            queued=self.sender.queued,
            replaced=self.sender.replaced,
            refused=self.refused + self.sender.refused,
            subscriptions=len(self.matches),
            at_ns=monotonic_ns(),
        )

    def count_ready(self) -> int:
        matches, expected = self.matches, self.sender.expected
        if not expected:
            return len(matches)
        return len(matches) - sum(other in matches for other in tuple(expected))  # a copy: any thread may ask

    def least_depth(self) -> int:
        """The smallest depth of the subscriptions; 0 if all of them keep all."""
        depths = [one.qos.depth for one in self.matches.values() if one.qos.history is History.KEEP_LAST]
        return 0 if self.qos.is_lossless else min(depths, default=0)

    @property
    def is_drained(self) -> bool:
        return not (self.sender.has_unsent or self.link.is_writing)

    def refuse_threads(self, reason: BusError) -> None:
        self.sender.refuse_threads(reason)

    async def drain(self) -> None:
        """Before the end: hand over as much as possible in a bounded time, and log the number of lost
        messages."""
        with contextlib.suppress(TimeoutError, ConnectionClosed):
            async with asyncio.timeout(_DRAIN_S if self.id else 0):
                await self.sender.flush()
        self.sender.drop_queued()

    # --- for the link

    @property
    def shared(self) -> tuple[Descriptor, ...]:
        return self.sender.shared

    def hand_over(self) -> None:
        self.sender.hand_over()

    def declaration(self, request: int, node: int) -> m.Message:
        return m.CreatePublisher(
            request=request,
            node=node,
            topic=self.topic_name,
            type_name=self.support.name,
            type_hash=self.support.hash,
            qos=self.qos,
            gid=self._own_gid,
            next_seq=self.sender.first_seq_to_send(),
            descriptors=len(self.shared),
            stands_for=b"" if self.gid == self._own_gid else self.gid,
            places=self.sender.places if self.matches.total else (),
        )

    def declared(self, answer: m.Created) -> None:
        super().declared(answer)
        self.max_bytes = answer.max_message_bytes
        self.sender.declared(answer)

    def disconnected(self) -> None:
        self.id = 0  # before the matches are removed: readers of our ring continue
        super().disconnected()
        self.sender.disconnected()

    def handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None:
        match message:
            case m.Credit(seq=seq):
                self.sender.credit(seq)
            case m.LivelinessLost():
                self._lost_liveliness += 1
                self.notify(self.events.liveliness_lost, LivelinessLost(self._lost_liveliness, 1))
            case m.Silence(subscription=other) if (match := self.matches.find(other)) is not None:
                self._report_silence(message, match)
            case m.Matched():
                if message.route != Route.BRIDGE:
                    self.sender.matched(message)
                super().handle(message)
            case m.Unmatched(other=other):
                if message.keep_s or self.matches.find(other) is None:
                    self.sender.keep_place(other, message.keep_s)
                super().handle(message)
            case m.Attached(subscription=other) if (match := self.matches.find(other)) is not None:
                try:
                    self.sender.attach(match.gid, message, descriptors)
                except (OSError, ValueError) as error:
                    refusal = m.RefuseRoute(endpoint=self.id, other=other, text=str(error)[:1000])
                    self.link.send_about(self, refusal)
                self.matches.release(self.count_ready)
            case m.Rerouted(other=other) if (match := self.matches.find(other)) is not None:
                self.sender.rerouted(match.gid, match.qos, message)
                super().handle(message)
                self.matches.release(self.count_ready)
            case _:
                super().handle(message)

    def totals(self) -> m.Report:
        """This publisher's counters, for the graph."""
        sender = self.sender
        sender.reported()
        samples, size = sender.published
        dropped: dict[str, int] = {DropReason.REPLACED: sender.replaced} if sender.replaced else {}
        report = m.Report(
            endpoint=self.id,
            samples=samples,
            bytes=size,
            queued=sender.queued,
            dropped=dropped,
            at_ns=monotonic_ns(),
        )
        return report if self.besides is None else self.with_besides(report, self.besides)

    def end(self, reason: Any) -> None:
        super().end(reason)
        self.sender.end(reason)

    def abandon(self, reason: BusError) -> None:
        super().abandon(reason)
        self.sender.abandon(reason)

    # --- inside

    def remove_match(self, other: int, *, is_lost: bool = False) -> None:
        gone = self.matches.find(other)
        super().remove_match(other)
        if gone is not None and self.id and gone.route != Route.BRIDGE:
            self.sender.unmatched(other, gone.gid, is_lost=is_lost)

    def describe_incompatible_qos(self) -> str:
        return (
            f"New subscription discovered on topic '{self.topic_name}', requesting incompatible QoS. "
            "No messages will be sent to it"
        )

    def newest_ns(self) -> int:
        return self.sender.last_ns

    def _report_silence(self, silence: m.Silence, match: Match) -> None:
        from bus.diagnostics.provoked import warn

        self.sender.set_waiting(match.gid, is_on=silence.is_over)
        time = f"{silence.silent_s:.1f} s"
        if silence.is_over:
            text = f"'{self.topic_name}' waits for {match.node} again, which was silent for {time}"
        else:
            text = f"'{self.topic_name}' goes on without {match.node}: no sign of life for {time}"
        warn(self.logger, text)

"""The route in of one far publisher's messages: from the engine's reader to its mirror on this bus.

Decides which messages are published: new ones, within their lifespan and the rate of a rule. `far_reading`
decides when they are read, and `publishing` how they are published. Must not know nodes or the graph.
"""

from collections.abc import Callable
from functools import partial
from time import monotonic_ns
from typing import Any

from bus.endpoint.core import summed
from bus.publisher import Publisher
from bus.qos import Durability, History
from bus.schema import MessageSchema
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose
from bus_bridge.core.accounts import Account
from bus_bridge.core.continuity import Continuity, ContinuityEvent, Listeners
from bus_bridge.core.far_reading import FarReading, ReadingState
from bus_bridge.core.journal import Entry
from bus_bridge.core.lateness import Lateness
from bus_bridge.core.pasts import Past
from bus_bridge.core.publishing import Publishing
from bus_bridge.core.waiting import RateLimit
from bus_bridge.engine import Engine, FarEndpoint
from bus_bridge.errors import in_words

__all__ = ["Import"]


class Import:
    """The route in of a far publisher. `on_trouble` gets an explanation if messages can't come in.

    `numbering`: as in Past.
    """

    def __init__(
        self,
        engine: Engine,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        publisher: Publisher[Any],
        lateness: Lateness,
        on_trouble: Callable[[str], object],
        *,
        numbering: str = "",
        max_rate_hz: float | None = None,
    ) -> None:
        self._qos = endpoint.qos
        self._is_lossless = endpoint.qos.is_lossless
        self._lifespan_ns = endpoint.qos.lifespan_ns
        self._numbering = numbering
        self._on_trouble = on_trouble
        self._lateness = lateness
        self._newest_ns = 0
        """Time at which the publisher published the newest message, by its clock."""
        self._limit = None if max_rate_hz is None else RateLimit(max_rate_hz)
        self._continuity = continuity = Continuity()
        self._listeners = Listeners()
        self.entry: Entry | None = None
        """Notes for the next process. None: there is no journal, or the numbers are those of another
        mirror."""
        self._noted: frozenset[bytes] | None = None
        """The subscriptions in the entry."""
        begin = partial(continuity.on, ContinuityEvent.INTERRUPT)
        self._reading = FarReading(engine, endpoint, schema, self.receive, begin, self.on_matched, on_trouble)
        self._publishing = Publishing(
            publisher, Account(), self._room_made, on_trouble, is_lossless=self._is_lossless
        )

    def resume(self, past: Past) -> None:
        """Continue after the end of an earlier route of the publisher. Call this before any other method."""
        self._publishing.account = past.account
        # A new mirror has no history for late joiners, so the history must come again.
        restores = self._qos.durability is Durability.TRANSIENT_LOCAL
        self._reading.resume(past.lost_before, restores=restores)
        self._newest_ns = past.newest_ns
        self._continuity.resume(past.last, restores=restores)
        self._listeners.resume(past.listeners, past.last)
        if past.numbering != self._numbering:
            self._renumber()

    @property
    def account(self) -> Account:
        return self._publishing.account

    @property
    def is_broken(self) -> bool:
        """Whether the mirror was closed, for example because a new busd refused it. It has to be made
        again."""
        return self._publishing.is_broken

    @property
    def waiting(self) -> int:
        return self._publishing.waiting.count

    @property
    def is_flowing(self) -> bool:
        return self._reading.is_flowing

    @property
    def taken(self) -> int:
        """Number of messages that arrived, including messages lost in the engine."""
        return self.account.taken + sum(self._reading.lost.values())

    @property
    def losses(self) -> dict[str, int]:
        """All dropped and lost messages, by reason."""
        return summed(self.account.losses, self._reading.lost)

    def on_matched(self) -> None:
        """Start or stop reading after a change of the mirror's matches."""
        if self._reading.state is not ReadingState.CLOSED:
            self._note_listeners()
            self._reading.want(bool(self._listeners.now))

    def begin_again(self, endpoint: FarEndpoint, *, numbering: str = "") -> None:
        """Continue after the far side was away: earlier messages don't come twice, and missed messages are
        lost.

        `numbering`: as in Past; other numbers may begin at 1.
        """
        self._reading.stop()
        self._reading.endpoint = endpoint
        if numbering != self._numbering:
            self._numbering = numbering
            self._renumber()
            self._end_entry()
        self.on_matched()

    def past(self) -> Past:
        """The state for the next route, in case the publisher comes back. Ask before the end of this
        route."""
        self._note_listeners()
        last, listeners, lost = self._continuity.last, self._listeners.before, self._reading.lost
        return Past(last, listeners, self.account, lost, self._numbering, self._newest_ns)

    def end(self) -> None:
        """Stop reading at the end of the bridge; waiting messages are lost."""
        self._reading.close()
        self._publishing.cancel()

    async def finish(self) -> None:
        """End the route of a far publisher that has gone: stop reading, and publish waiting messages while
        there is progress. Cancellation: waiting messages are lost, as in `end`."""
        self._reading.close()
        self._end_entry()
        if lost := await self._publishing.finish():
            self._on_trouble(
                f"their publisher has gone, and there was no room for all (messages lost: {lost})"
            )

    def receive(self, batch: Batch) -> None:
        """Handle the next messages of the far publisher, from the reader. Never raises."""
        if self._reading.state is ReadingState.CLOSED:
            return
        publishing = self._publishing
        publishing.account.taken += batch.count
        size = publishing.waiting.bytes + batch.payload_bytes
        try:
            right = batch if self._continuity.follows(batch) else self._new_ones(batch)
            if right is not None:
                if self._lifespan_ns:
                    right = self._without_expired(right)
                else:
                    self._lateness.note(monotonic_ns(), right.last_time_ns, self._newest_ns)
                    self._newest_ns = right.last_time_ns
            if right is not None and self._limit is not None:
                right = self._within_rate(right, self._limit)
            if self._is_lossless:
                if right is not None:
                    publishing.publish_or_wait(right)
                if gone := size - publishing.waiting.bytes:
                    # Includes messages dropped here: the writer does not wait for them.
                    self._reading.taken(gone)
                self._note()
            elif right is not None:
                if self.entry is not None:
                    self._note()  # first: if the bridge is killed in between, no message counts twice
                publishing.publish(right)
        except Exception as error:  # an error in one route must not end the others
            self._on_trouble(in_words(error))

    # --- internal

    def _renumber(self) -> None:
        """Prepare for messages with other numbers. Messages that came before are recognized by their time.

        At most the publisher's depth can come again: messages that it keeps, and messages that waited for the
        new route.
        """
        qos, sent = self._qos, self.account.sent
        copies = min(qos.depth, sent) if qos.history is History.KEEP_LAST else sent
        self._continuity.renumber(copies, self._newest_ns)
        self._listeners.forget()

    def _room_made(self, size: int) -> None:
        """Handle `size` bytes of waiting messages that were published or dropped."""
        self._reading.taken(size)
        self._note()

    def _note(self) -> None:
        """Note the last message that does not wait, and its receivers, for the next process."""
        if self.entry is None:
            return
        if self._noted is not self._listeners.now:
            self._noted = self._listeners.now
            self.entry.note_listeners(self._noted)
        self.entry.note(max(0, self._continuity.last - self._publishing.waiting.count), self._newest_ns)

    def _end_entry(self) -> None:
        entry, self.entry = self.entry, None
        if entry is not None:
            entry.end()

    def _note_listeners(self) -> None:
        gids = frozenset(match.gid for match in self._publishing.publisher.matches)
        self._listeners.change(gids, self._continuity.last)

    def _new_ones(self, batch: Batch) -> Batch | None:
        found, account = self._continuity.classify(batch), self.account
        account.drop(DropReason.REPEATED, found.repeated)
        missing = found.lost
        if found.missed and self._listeners.are_back:
            missing += found.missed
        lost = self._reading.lost
        # A repeated message leaves no gap in the numbers.
        account.miss(missing, sum(lost.values()) - lost.get(DropReason.REPEATED, 0))
        return found.batch

    def _without_expired(self, batch: Batch) -> Batch | None:
        now_ns, lateness, lifespan_ns = monotonic_ns(), self._lateness, self._lifespan_ns
        for sample in batch:
            lateness.note(now_ns, sample.source_time_ns, self._newest_ns)
            self._newest_ns = sample.source_time_ns
        kept = [one for one in batch if lateness.age_ns(now_ns, one.source_time_ns) <= lifespan_ns]
        self.account.drop(DropReason.EXPIRED, batch.count - len(kept))
        return Loose.some(kept)

    def _within_rate(self, batch: Batch, limit: RateLimit) -> Batch | None:
        passing = limit.passing(batch)
        self.account.drop(DropReason.RATE_LIMIT, batch.count - len(passing))
        return Loose.some(passing)

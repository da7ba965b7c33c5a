"""The route out of one publisher's messages: from a tap to the engine's writer.

Owns the waiting messages, and the counters of the route. Must not know nodes, taps or the graph.
"""

from collections.abc import Callable

from bus.endpoint.core import summed
from bus.qos import History, QoSProfile
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose
from bus_bridge.core.accounts import Account
from bus_bridge.core.continuity import Continuity, ContinuityEvent
from bus_bridge.core.waiting import RateLimit, Waiting
from bus_bridge.engine import RouteRule, Writer

__all__ = ["PATIENCE_S", "Export"]

_MOST_BYTES = 64 << 20
_MOST_LOSSLESS_BYTES = 256 << 20
"""The limit of a subscription: a lossless publisher may have published that much before it waits."""
_LOSSLESS_BYTES = 1 << 20
"""Above this size of waiting messages, a lossless publisher waits."""
PATIENCE_S = 30.0
"""Longest time that a lossless publisher waits for a route that its match on the far side announces."""
_AT_ONCE = 256


class Export:
    """The route out of a publisher. `depth` is the number of messages that may wait.

    `is_matched` returns whether a far subscription is matched with the publisher on this bus. If so, its
    messages wait until the route is ready. `on_free` is called when it is no longer `is_full`.
    """

    def __init__(
        self,
        gid: bytes,
        depth: int,
        is_matched: Callable[[bytes], bool],
        on_free: Callable[[bytes], object],
        *,
        is_lossless: bool = False,
    ) -> None:
        self.gid = gid
        self.account = Account()
        self.writer: Writer | None = None
        self._lost_before: dict[str, int] = {}
        """Messages lost in earlier writers, by reason."""
        self._continuity = Continuity()
        self._depth = depth
        self._patience = depth
        """Number of messages that may wait until the route is ready."""
        self.is_lossless = is_lossless
        self._is_matched = is_matched
        self._on_free = on_free
        self._waiting = Waiting(_most_bytes(is_lossless=is_lossless))
        self._waits_since_s: float | None = None
        self._is_given_up = False
        self._limit: RateLimit | None = None

    def attach(self, writer: Writer, qos: QoSProfile, rule: RouteRule) -> None:
        """Use `writer`: the far side can see the publisher now."""
        was_full = self.is_full
        self.writer = writer
        self._depth = rule.depth or self._depth
        self.is_lossless = qos.is_lossless
        self._waiting.max_bytes = _most_bytes(is_lossless=qos.is_lossless)
        self._patience = min(qos.depth, self._depth) if qos.history is History.KEEP_LAST else self._depth
        self._limit = None if rule.max_rate_hz is None else RateLimit(rule.max_rate_hz)
        if was_full and not self.is_full:  # the rule has more room: the taps hold the publisher back no more
            self._on_free(self.gid)
        self.flush()

    @property
    def waiting(self) -> int:
        return self._waiting.count

    @property
    def sent(self) -> int:
        """Number of sent messages, without messages that the engine dropped afterwards."""
        return self.account.sent - sum(self._lost_by_engine.values())

    @property
    def losses(self) -> dict[str, int]:
        """All dropped and lost messages, by reason."""
        return summed(self.account.losses, self._lost_by_engine)

    @property
    def _lost_by_engine(self) -> dict[str, int]:
        return self._lost_before if self.writer is None else summed(self._lost_before, self.writer.lost)

    @property
    def is_full(self) -> bool:
        """Whether the publisher must wait: there is no more room here, and no message may be lost."""
        waiting = self._waiting
        return self.is_lossless and (waiting.count >= self._depth or waiting.bytes >= _LOSSLESS_BYTES)

    @property
    def is_flowing(self) -> bool:
        return self.writer is not None and self.writer.is_wanted

    def begin(self, *, is_back: bool) -> None:
        """Start with new taps. `is_back`: the far subscription was here before."""
        self._continuity.on(ContinuityEvent.INTERRUPT if is_back else ContinuityEvent.RESTART)

    def put(self, batch: Batch) -> None:
        """Add the next messages of the publisher, in order."""
        account = self.account
        account.taken += batch.count
        if not self._continuity.follows(batch):
            fresh = self._new_ones(batch)
            if fresh is None:
                return
            batch = fresh
        if self._limit is not None:
            passing = Loose.some(self._limit.passing(batch))
            account.drop(DropReason.RATE_LIMIT, batch.count - (0 if passing is None else passing.count))
            if passing is None:
                return
            batch = passing
        writer = self.writer
        if writer is not None and not self._waiting.count and writer.is_wanted:
            sent = self._write(writer, batch)
            if sent == batch.count:
                return
            batch = batch.after(sent)
        self._wait(batch)

    def flush(self) -> None:
        """Send waiting messages. To be called if the writer may have room or its state changed, or a match
        changed."""
        waiting, writer = self._waiting, self.writer
        was_full, has_room = self.is_full, True
        self._is_given_up &= not self.is_flowing
        while waiting.count and has_room and writer is not None and writer.is_wanted:
            batch = waiting.first(_AT_ONCE)
            assert batch is not None
            sent = self._write(writer, batch)
            waiting.remove(sent)
            has_room = sent == batch.count
        if waiting.count and writer is not None and not writer.is_wanted and not self._is_matched(self.gid):
            self.account.drop(DropReason.NOT_WANTED, waiting.clear())
        if was_full and not self.is_full:
            self._on_free(self.gid)

    def has_timed_out(self, now_s: float) -> bool:
        """Whether a far side that does not read has held up the publisher for half a minute.

        Ask from time to time. If so, this drops waiting messages, and later ones too, until the far side
        reads.
        """
        if self.is_flowing or not self.is_full:
            self._waits_since_s = None
            return False
        if self._waits_since_s is None:
            self._waits_since_s = now_s
        if now_s - self._waits_since_s < PATIENCE_S:
            return False
        self._is_given_up, self._waits_since_s = True, None
        self.account.drop(DropReason.NOT_WANTED, self._waiting.clear())
        self._on_free(self.gid)
        return True

    def detach(self) -> None:
        """Drop the writer: the far side does not see the publisher any more. Waiting messages stay."""
        writer, self.writer = self.writer, None
        if writer is not None:
            self._lost_before = summed(self._lost_before, writer.lost)
            writer.close()

    def close(self) -> None:
        """End the route of a publisher that has gone; waiting messages are lost."""
        self.account.drop(DropReason.DISCONNECTED, self._waiting.clear())
        self.detach()
        self._on_free(self.gid)

    def _new_ones(self, batch: Batch) -> Batch | None:
        """The messages of `batch` that had not come before.

        Missing messages were lost in the tap, or were published while a far subscription was disconnected.
        """
        continuity, account = self._continuity, self.account
        is_jump = batch.first_number > continuity.last  # otherwise another tap receives a history again
        found = continuity.jump(batch) if is_jump else continuity.classify(batch)
        account.taken += found.lost + found.missed
        account.drop(DropReason.REPEATED, found.repeated)
        account.drop(DropReason.REPLACED, found.lost)
        account.drop(DropReason.NOT_WANTED, found.missed)
        return found.batch

    def _wait(self, batch: Batch) -> None:
        writer, depth = self.writer, self._depth
        if writer is None or not writer.is_wanted:
            if self._is_given_up or not self._is_matched(self.gid):
                self.account.drop(DropReason.NOT_WANTED, batch.count)
                return
            depth = self._patience
        replaced, over = self._waiting.put(batch, None if self.is_lossless else depth)
        self.account.drop(DropReason.REPLACED, replaced)
        self.account.drop(DropReason.MEMORY_LIMIT, over)

    def _write(self, writer: Writer, batch: Batch) -> int:
        sent = writer.write(batch)
        account = self.account
        account.sent += sent
        if sent == batch.count:
            account.bytes += batch.payload_bytes
        elif sent:
            account.bytes += batch.payload_bytes - batch.after(sent).payload_bytes
        return sent


def _most_bytes(*, is_lossless: bool) -> int:
    return _MOST_LOSSLESS_BYTES if is_lossless else _MOST_BYTES

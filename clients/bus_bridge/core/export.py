"""The way out of one publisher's messages: from what a tap has taken to the engine's writer.

Owns the waiting messages, and the account of each message. Must not know nodes, taps or the graph.
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
"""As much as a subscription may hold: a lossless publisher may have published so much before it waits."""
_LOSSLESS_BYTES = 1 << 20
"""So much of a lossless publisher waits here before that waits itself."""
PATIENCE_S = 30.0
"""So long a lossless publisher waits for a way that its match on the far side makes us expect."""
_AT_ONCE = 256


class Export:
    """`depth` is how many messages may wait. `is_matched` says whether a far subscription is matched with the
    publisher on this bus: then its messages wait until the way is made.

    `on_free` is called when it `is_full` no longer.
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
        """Messages that earlier writers had and lost, by reason."""
        self._continuity = Continuity()
        self._depth = depth
        self._patience = depth
        """How many messages may wait for the way to be made."""
        self.is_lossless = is_lossless
        self._is_matched = is_matched
        self._on_free = on_free
        self._waiting = Waiting(_most_bytes(is_lossless=is_lossless))
        self._waits_since_s: float | None = None
        self._is_given_up = False
        self._limit: RateLimit | None = None

    def attach(self, writer: Writer, qos: QoSProfile, rule: RouteRule) -> None:
        """The publisher is shown to the far side."""
        self.writer = writer
        self.is_lossless = qos.is_lossless
        self._waiting.max_bytes = _most_bytes(is_lossless=qos.is_lossless)
        self._patience = min(qos.depth, self._depth) if qos.history is History.KEEP_LAST else self._depth
        self._limit = None if rule.max_rate_hz is None else RateLimit(rule.max_rate_hz)
        self.flush()

    @property
    def waiting(self) -> int:
        return self._waiting.count

    @property
    def sent(self) -> int:
        """Messages that have left, without those that the engine dropped afterwards."""
        return self.account.sent - sum(self._lost_by_engine.values())

    @property
    def losses(self) -> dict[str, int]:
        """All that did not go on, by reason."""
        return summed(self.account.losses, self._lost_by_engine)

    @property
    def _lost_by_engine(self) -> dict[str, int]:
        return self._lost_before if self.writer is None else summed(self._lost_before, self.writer.lost)

    @property
    def is_full(self) -> bool:
        """Whether its publisher is to wait: no more has room here, and nothing must be lost."""
        waiting = self._waiting
        return self.is_lossless and (waiting.count >= self._depth or waiting.bytes >= _LOSSLESS_BYTES)

    @property
    def is_flowing(self) -> bool:
        return self.writer is not None and self.writer.is_wanted

    def begin(self, *, is_back: bool) -> None:
        """There are taps again. `is_back`: for a far subscription that was here before."""
        self._continuity.on(ContinuityEvent.INTERRUPT if is_back else ContinuityEvent.RESTART)

    def put(self, batch: Batch) -> None:
        """The next messages of the publisher, in order."""
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
        """The writer can take more, perhaps, or is wanted no longer; or a match has come or gone."""
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
        """To be asked from time to time: whether its publisher has been held up for half a minute by a far
        side that does not read. If so, waiting messages are dropped, and later ones too, until the far side
        reads."""
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
        """The far side sees the publisher no more; what waits, waits on."""
        writer, self.writer = self.writer, None
        if writer is not None:
            self._lost_before = summed(self._lost_before, writer.lost)
            writer.close()

    def close(self) -> None:
        """The publisher has gone; waiting messages are lost."""
        self.account.drop(DropReason.DISCONNECTED, self._waiting.clear())
        self.detach()
        self._on_free(self.gid)

    def _new_ones(self, batch: Batch) -> Batch | None:
        """The messages of `batch` that had not come before. Missing ones were lost in the tap, or published
        while a far subscription was cut off."""
        continuity, account = self._continuity, self.account
        is_jump = batch.first_number > continuity.last  # otherwise a history comes again, to another tap
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

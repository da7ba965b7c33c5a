"""The way out of one publisher's messages: from what a tap has taken to the engine's writer.

Owns what waits, and what became of each message. Must not know nodes, taps or the graph.
"""

from collections.abc import Callable, Sequence

from bus.endpoint.core import summed
from bus.qos import History, QoSProfile
from bus_bridge.core.accounts import Account
from bus_bridge.core.waiting import RateLimit, Waiting
from bus_bridge.engine import RouteRule, Sample, Writer
from bus_bridge.packed import number_and_time, payload_bytes
from bus_bridge.reasons import DISCONNECTED, MEMORY, NOT_WANTED, RATE, REPEATED, REPLACED

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
        """By reason, what earlier writers had and lost."""
        self._is_fresh = True
        """What comes next may begin anywhere: there was no tap before."""
        self._is_back = False
        """What is missing before the next message was published while a far subscription was cut off."""
        self._depth = depth
        self._patience = depth
        """How many messages may wait for the way to be made."""
        self._is_lossless = is_lossless
        self._is_matched = is_matched
        self._on_free = on_free
        self._waiting = Waiting(_most_bytes(is_lossless=is_lossless))
        self._last = 0
        self._waits_since_s: float | None = None
        self._is_given_up = False
        self._limit: RateLimit | None = None

    def attach(self, writer: Writer, qos: QoSProfile, rule: RouteRule) -> None:
        """The publisher is shown to the far side."""
        self.writer = writer
        self._is_lossless = qos.is_lossless
        self._waiting.max_bytes = _most_bytes(is_lossless=qos.is_lossless)
        self._patience = min(qos.depth, self._depth) if qos.history is History.KEEP_LAST else self._depth
        self._limit = None if rule.max_rate_hz is None else RateLimit(rule.max_rate_hz)
        self.flush()

    @property
    def waiting(self) -> int:
        return len(self._waiting)

    @property
    def sent(self) -> int:
        """Messages that have gone, without those that the engine has dropped afterwards."""
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
        return self._is_lossless and (len(waiting) >= self._depth or waiting.bytes >= _LOSSLESS_BYTES)

    @property
    def is_flowing(self) -> bool:
        return self.writer is not None and self.writer.is_wanted

    def begin(self, *, is_back: bool) -> None:
        """There are taps again. `is_back`: for a far subscription that was here before."""
        self._is_fresh, self._is_back = self._is_fresh or not is_back, is_back

    def put(self, samples: Sequence[Sample]) -> None:
        """The next messages of the publisher, in order."""
        account = self.account
        account.taken += len(samples)
        first, last = number_and_time(samples, 0)[0], number_and_time(samples, -1)[0]
        if first <= self._last:  # a transient local publisher's history, to another tap
            fresh = [sample for sample in samples if sample.number > self._last]
            account.drop(REPEATED, len(samples) - len(fresh))
            if not fresh:
                return
            samples = fresh
        elif not self._is_fresh and (missing := last - self._last - len(samples)) > 0:
            account.taken += missing
            account.drop(NOT_WANTED if self._is_back else REPLACED, missing)
        self._is_fresh = self._is_back = False
        self._last = last
        if self._limit is not None:
            passing = self._limit.passing(samples)
            account.drop(RATE, len(samples) - len(passing))
            if not passing:
                return
            samples = passing
        writer = self.writer
        if writer is not None and not self._waiting and writer.is_wanted:
            sent = self._write(writer, samples)
            if sent == len(samples):
                return
            samples = samples[sent:]
        self._wait(samples)

    def flush(self) -> None:
        """The writer can take more, perhaps, or is wanted no longer; or a match has come or gone."""
        waiting, writer = self._waiting, self.writer
        was_full, has_room = self.is_full, True
        self._is_given_up &= not self.is_flowing
        while waiting and has_room and writer is not None and writer.is_wanted:
            samples = waiting.first(_AT_ONCE)
            sent = self._write(writer, samples)
            waiting.remove(sent)
            has_room = sent == len(samples)
        if waiting and writer is not None and not writer.is_wanted and not self._is_matched(self.gid):
            self.account.drop(NOT_WANTED, waiting.clear())
        if was_full and not self.is_full:
            self._on_free(self.gid)

    def has_waited_in_vain(self, now_s: float) -> bool:
        """To be asked from time to time: whether its publisher is held up for a far side that does not read
        it, and was so all the time for half a minute. Then what waits is given up, and what follows too until
        somebody reads it."""
        if self.is_flowing or not self.is_full:
            self._waits_since_s = None
            return False
        if self._waits_since_s is None:
            self._waits_since_s = now_s
        if now_s - self._waits_since_s < PATIENCE_S:
            return False
        self._is_given_up, self._waits_since_s = True, None
        self.account.drop(NOT_WANTED, self._waiting.clear())
        self._on_free(self.gid)
        return True

    def detach(self) -> None:
        """The far side sees the publisher no more; what waits, waits on."""
        writer, self.writer = self.writer, None
        if writer is not None:
            self._lost_before = summed(self._lost_before, writer.lost)
            writer.close()

    def close(self) -> None:
        """The publisher has gone; what waits is lost."""
        self.account.drop(DISCONNECTED, self._waiting.clear())
        self.detach()
        self._on_free(self.gid)

    def _wait(self, samples: Sequence[Sample]) -> None:
        writer, depth = self.writer, self._depth
        if writer is None or not writer.is_wanted:
            if self._is_given_up or not self._is_matched(self.gid):
                self.account.drop(NOT_WANTED, len(samples))
                return
            depth = self._patience
        replaced, over = self._waiting.put(samples, None if self._is_lossless else depth)
        self.account.drop(REPLACED, replaced)
        self.account.drop(MEMORY, over)

    def _write(self, writer: Writer, samples: Sequence[Sample]) -> int:
        sent = writer.write(samples)
        account = self.account
        account.sent += sent
        account.bytes += payload_bytes(samples if sent == len(samples) else samples[:sent])
        return sent


def _most_bytes(*, is_lossless: bool) -> int:
    return _MOST_LOSSLESS_BYTES if is_lossless else _MOST_BYTES

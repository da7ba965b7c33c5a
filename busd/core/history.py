"""Samples of one publisher in few runs: its history, and samples for the many subscriptions of a process.

To hand samples on costs a step for each run, and a paced publisher sends each sample as a separate run. So
the samples of runs of a few samples are gathered into runs of up to 64 KiB. Knows no subscription and no
clock.
"""

from collections.abc import Iterator

from bus.wire.layout import MAX_RUN_SAMPLES, RECORD_HEAD, RECORD_HEAD_BYTES, RUN_BYTES
from bus.wire.runs import Account, Run, RunQueue

_PART = 64
"""A run grows to at most this part of its account's limit, because a full account drops whole runs."""
_FEW_SAMPLES = 32
"""A run of more is kept as it is: to check it costs a step for each sample."""


class GatheredRuns(RunQueue):
    """A queue like RunQueue, for one publisher: `depth` samples (0: not bounded by number) in few runs."""

    __slots__ = ("_growing",)

    def __init__(self, depth: int, account: Account) -> None:
        super().__init__(depth, account)
        self._growing: bytearray | None = None
        """The body of the newest run, while small runs may join it."""

    def append(self, run: Run) -> bool:
        """Append the samples of `run`; returns whether there are more now than may be."""
        # A larger run is not worth the copy; behind a malformed run, no sample would be found.
        most_bytes = self._most_bytes
        if 2 * len(run.body) > most_bytes or run.count > _FEW_SAMPLES or not run.is_whole:
            self._growing = None
            return super().append(run)
        if self._join(run, most_bytes):
            return self.is_overfull
        self._growing = bytearray(run.body)
        own = Run(0, run.source, run.first_seq, run.count, self._growing, lifespan_ns=run.lifespan_ns)
        return super().append(own)

    @property
    def _most_bytes(self) -> int:
        """How large a run may grow."""
        account = self.account
        limit = account.limit if account.parent is None else min(account.limit, account.parent.limit)
        return min(RUN_BYTES, limit // _PART)

    def close(self) -> None:
        """The runs that are there grow no more: others may hold them."""
        self._growing = None

    def _join(self, run: Run, most_bytes: int) -> bool:
        """Add the samples to the newest run; False if they don't fit or don't follow."""
        body, size = self._growing, len(run.body)
        newest = self.runs[-1] if self.runs else None
        if body is None or newest is None or newest.body is not body:
            return False
        if (
            len(body) + size > most_bytes
            or newest.count + run.count > MAX_RUN_SAMPLES
            or newest.first_seq + newest.count != run.first_seq
        ):
            return False
        body += run.body
        newest.count += run.count
        newest.newest_ns = None
        self.count += run.count
        self.held_bytes += size
        self.account.charge(size)
        return True


class PublisherHistory(GatheredRuns):
    """The samples that a transient local publisher keeps for late joiners."""

    __slots__ = ()

    def drop_expired(self, now_ns: int, gone: list[Run] | None = None) -> int:
        """As RunQueue's. The stamps of one publisher grow: a run is older than the first of the next one."""
        dropped = 0
        while len(self.runs) > 1 and _begins_expired(self.runs[1], now_ns):
            oldest = self.runs[0]
            dropped += oldest.count - self.skipped
            self.forget_head()
            if gone is not None:
                gone.append(oldest)
        return dropped + super().drop_expired(now_ns, gone)

    def newest(self, count: int, after_seq: int) -> Iterator[Run]:
        """As RunQueue's. A run that may still grow is copied: a buffer with a view can't grow."""
        for replay in super().newest(count, after_seq):
            if isinstance(replay.body, memoryview) and replay.body.obj is self._growing:
                replay.body = bytes(replay.body)
            yield replay


def _begins_expired(run: Run, now_ns: int) -> bool:
    """Whether its first sample is older than its lifespan."""
    if not run.lifespan_ns or len(run.body) < RECORD_HEAD_BYTES:
        return False
    stamp_ns: int = RECORD_HEAD.unpack_from(run.body)[1]
    return stamp_ns + run.lifespan_ns < now_ns

"""Runs of samples, and the one bounded queue of the bus.

A `Run` is the content of a data frame. A `RunQueue` holds waiting runs at a publisher (to be handed over), in
the broker (to be sent to one subscription) or in a subscription (to be taken). It counts samples, not runs.
It drops the oldest first, and returns the number of dropped samples to its caller.

Cost: pushing and popping a run is O(1) for any number of samples in it; trimming walks the samples that it
drops. Knows no I/O and no clock.
"""

from collections import deque
from collections.abc import Iterator

import msgspec

from bus.wire.layout import (
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    LENGTH_BYTES,
    RECORD_HEAD,
    RECORD_HEAD_BYTES,
    REPLAY,
    RESUMED,
)

Buffer = bytes | bytearray | memoryview

_unpack_record = RECORD_HEAD.unpack_from
RUN_COST_BYTES = 256
"""Approximate memory of a run besides its body.

It is charged, too, because small runs consist mostly of it.
"""

UNBOUNDED = 1 << 62
_OVERHEAD_BYTES = DATA_HEAD_BYTES - LENGTH_BYTES


class Run(msgspec.Struct, eq=False, gc=False):
    """Samples of one publisher with consecutive sequence numbers, shared by all queues in which it waits.

    `body` is `count` records back to back. A replay carries samples published before the subscription
    existed; they don't count against its depth. (A msgspec Struct, because each frame needs one, and msgspec
    makes it in C.)
    """

    endpoint: int
    source: int
    """The publisher; 0 on the way to the broker, where `endpoint` is the publisher."""
    first_seq: int
    count: int
    body: Buffer
    is_replay: bool = False
    lifespan_ns: int = 0
    """The publisher's lifespan; 0 = for ever."""
    received_ns: int = 0
    """Time of receipt in the subscription's process; monotonic clock."""
    origin: object = None
    """The subscription's object for the publisher."""
    is_resumed: bool = False
    """Samples with the missing numbers before the run used another route and are not lost."""
    only_for: int = 0
    """On the way to the broker: the only subscription for the run; 0: all routed subscriptions."""
    newest_ns: int | None = None
    """The latest stamp in the run; None: not read yet. All queues of the run share it."""
    pieces: tuple[Buffer, ...] = ()
    """The body in pieces, if it is not in one place; the use of `body` as a buffer joins them."""
    cut: tuple[int, int] = (0, 0)
    """The records and bytes before the place at which a queue cut it last. Queues of one depth cut it there,
    too, without a step for each record."""

    def cut_at(self, count: int, known: int, offset: int) -> tuple[int, int]:
        """The offset behind the first `count` records, and the steps that this took.

        `offset` is the one behind the first `known` records, which are not more.
        """
        if known <= self.cut[0] <= count:
            known, offset = self.cut
        offset = _walk(self.body, offset, count - known)
        self.cut = count, offset
        return offset, count - known

    def after(self, seq: int) -> "Run":
        """The rest of the run after number `seq`, which is in the run and not its last."""
        known = seq + 1 - self.first_seq
        body = memoryview(self.body)[_walk(self.body, 0, known) :]
        return Run(
            self.endpoint,
            self.source,
            seq + 1,
            self.count - known,
            body,
            self.is_replay,
            self.lifespan_ns,
            self.received_ns,
            self.origin,
        )

    @property
    def is_whole(self) -> bool:
        """Whether the records fill the body exactly. Costs a step for each sample."""
        offset, size = 0, len(self.body)
        for _ in range(self.count):
            if offset + RECORD_HEAD_BYTES > size:
                return False
            offset += RECORD_HEAD_BYTES + _unpack_record(self.body, offset)[0]
        return offset == size

    def records(self) -> Iterator[tuple[memoryview, int]]:
        """Each payload with its stamp; stops early if the body is shorter than it claims."""
        offset, body = 0, memoryview(self.body)
        for _ in range(self.count):
            start = offset + RECORD_HEAD_BYTES
            if start > len(body):
                return
            size, stamp_ns = _unpack_record(body, offset)
            offset = start + size
            if offset > len(body):
                return
            yield body[start:offset], stamp_ns


def data_head(
    endpoint: int, first_seq: int, count: int, body_bytes: int, *, flags: int = 0, only_for: int = 0
) -> bytes:
    """The header of a data frame towards the broker; `only_for`: a single subscription."""
    size = _OVERHEAD_BYTES + body_bytes
    return DATA_HEAD.pack(size, DATA, flags, 0, endpoint, only_for, first_seq, count, 0)


def _walk(body: Buffer, offset: int, count: int) -> int:
    """The offset behind `count` records; the end of the body if it is shorter than it claims."""
    for _ in range(count):
        if offset + RECORD_HEAD_BYTES > len(body):
            break
        offset += RECORD_HEAD_BYTES + _unpack_record(body, offset)[0]
    return min(offset, len(body))


def _newest_stamp(body: Buffer, count: int) -> int:
    """The latest stamp of the `count` records in `body`; stops early if the body is shorter than it
    claims."""
    newest_ns = offset = 0
    last = len(body) - RECORD_HEAD_BYTES
    for _ in range(count):
        if offset > last:
            break
        size, stamp_ns = _unpack_record(body, offset)
        newest_ns = max(newest_ns, stamp_ns)
        offset += RECORD_HEAD_BYTES + size
    return newest_ns


def _walk_expired(body: Buffer, offset: int, count: int, limit_ns: int) -> tuple[int, int]:
    """Number of records older than `limit_ns` from `offset` on, up to the first newer one, and its offset.

    There are `count` records. If the body is shorter than it claims, all of them count as older.
    """
    last = len(body) - RECORD_HEAD_BYTES
    for expired in range(count):
        if offset > last:
            break
        size, stamp_ns = _unpack_record(body, offset)
        if stamp_ns >= limit_ns:
            return expired, offset
        offset += RECORD_HEAD_BYTES + size
    return count, offset


class Account:
    """The bytes that one holder uses of a resource, and its limit.

    Bytes charged to it are charged to its `parent`, too, which has the limit of several holders together.
    """

    __slots__ = ("limit", "parent", "used")

    def __init__(self, limit: int, parent: "Account | None" = None) -> None:
        self.limit = limit
        self.parent = parent
        self.used = 0

    def charge(self, size: int) -> None:
        """Add `size` bytes, or release them if `size` is negative. Hot paths inline this."""
        self.used += size
        if self.parent is not None:
            self.parent.used += size

    @property
    def is_over(self) -> bool:
        """Whether the holder uses more than its limit."""
        return self.used > self.limit


class RunQueue:
    """A first-in first-out queue of samples, bounded by `depth` samples (0: not bounded by number).

    `endpoint` is the address of the frames made from it. Its bytes are charged to `account`.
    """

    __slots__ = (
        "account",
        "bound",
        "count",
        "depth",
        "endpoint",
        "held_bytes",
        "is_ready",
        "offset",
        "rest",
        "runs",
        "skipped",
        "steps",
    )

    def __init__(self, depth: int, account: Account, endpoint: int = 0) -> None:
        self.account = account
        self.depth = depth
        # Most samples: the depth, and room for replayed samples until the queue is empty again.
        self.bound = depth or UNBOUNDED
        self.endpoint = endpoint
        self.runs: deque[Run] = deque()
        self.rest: deque[Run] = deque()  # dropped, and not freed yet
        self.count = 0
        self.held_bytes = 0  # bytes of the runs, with RUN_COST_BYTES for each
        # The head run may be partly used up: its used bytes and samples.
        self.offset = 0
        self.skipped = 0
        self.steps = 0  # records that the last drop looked at
        self.is_ready = False  # in the ready list of an Outbox

    def set_depth(self, depth: int) -> None:
        self.bound += (depth or UNBOUNDED) - (self.depth or UNBOUNDED)
        self.depth = depth

    def append(self, run: Run) -> bool:
        """Append `run`; returns whether the queue now exceeds its depth or quota and must be trimmed."""
        self.runs.append(run)
        self.count += run.count
        size = len(run.body) + RUN_COST_BYTES
        self.held_bytes += size
        account = self.account
        account.used += size
        if run.is_replay:
            self.bound += run.count
        parent = account.parent
        if parent is not None:
            parent.used += size
            if parent.used > parent.limit:
                return True
        return self.count > self.bound or account.used > account.limit

    @property
    def is_overfull(self) -> bool:
        """Whether the queue exceeds its depth, or its account a limit."""
        account = self.account
        is_over = account.is_over or (account.parent is not None and account.parent.is_over)
        return is_over or self.count > self.bound

    def trim(self) -> int:
        """Drop the oldest samples above the depth; returns their number."""
        return self.drop(self.count - self.bound) if self.count > self.bound else 0

    def push(self, run: Run) -> int:
        """Append `run`; returns the number of oldest samples replaced because of the depth."""
        return self.trim() if self.append(run) else 0

    def drop(self, count: int) -> int:
        """Drop the `count` oldest samples; returns the number dropped (less only if the queue had fewer)."""
        left, self.steps = count, 0
        while left and self.runs:
            run = self.runs[0]
            held = run.count - self.skipped
            if held <= left:
                left -= held
                self.forget_head()
            else:
                self._skip(run, left)
                left = 0
        return count - left

    def drop_expired(self, now_ns: int, gone: list[Run] | None = None) -> int:
        """Drop samples at the head that are older than their publisher's lifespan; returns their number.

        Completely dropped runs are added to `gone`.
        """
        dropped = 0
        while expired := self.drop_expired_of_head(now_ns, gone):
            dropped += expired
        return dropped

    def drop_expired_of_head(self, now_ns: int, gone: list[Run] | None = None) -> int:
        """The same only for the oldest run: a caller can bound the work by runs.

        A run that has expired as a whole is dropped in one step. Exception: the first of its queues reads its
        stamps.
        """
        if not self.runs:
            return 0
        run = self.runs[0]
        limit_ns, held = now_ns - run.lifespan_ns, run.count - self.skipped
        stamp_ns = self.peek_stamp()
        if not run.lifespan_ns or (stamp_ns is not None and stamp_ns >= limit_ns):
            return 0
        if run.newest_ns is None:
            run.newest_ns = _newest_stamp(run.body, run.count)
        expired, offset = held, self.offset
        if run.newest_ns >= limit_ns:
            expired, offset = _walk_expired(run.body, offset, held, limit_ns)
        if expired < held:
            self.advance(expired, offset)
            return expired
        self.forget_head()
        if gone is not None:
            gone.append(run)
        return expired

    def drop_over_quota(
        self,
        gone: list[Run] | None = None,
        *,
        spare: int = 0,
        account: Account | None = None,
        slack: int = 0,
        most: int = 0,
    ) -> int:
        """Drop whole runs, oldest first, until the account is within its limit; returns the samples dropped.

        `account`: its parent can be passed instead; `slack`: bytes below the limit to reach. The `spare`
        newest runs always stay. Dropped runs are added to `gone`. `most`: the limit of steps (0: none). Each
        step drops one run, but the last step of so many drops all runs except the spare ones, and leaves the
        dropped ones in `rest` for the caller to free.
        """
        dropped = 0
        account = account or self.account
        while len(self.runs) > spare and account.used > account.limit - slack:
            if not (most := most - 1):
                return dropped + self._drop_all(gone, spare)
            run = self.runs[0]
            held = run.count - self.skipped
            dropped += held
            self.forget_head()
            if gone is not None:
                gone.append(run)
        return dropped

    def _drop_all(self, gone: list[Run] | None, spare: int) -> int:
        """Drop all runs except the `spare` newest (1 or 0); returns the number of samples dropped."""
        newest = self.runs.pop() if spare else None
        size = len(newest.body) + RUN_COST_BYTES if newest is not None else 0
        dropped = self.count - (newest.count if newest is not None else 0)
        self.account.charge(size - self.held_bytes)
        self.count, self.held_bytes = self.count - dropped, size
        self.offset = self.skipped = 0
        if gone is not None:
            gone += self.runs
        self.rest = self.runs.copy()
        self.runs.clear()
        if newest is not None:
            self.runs.append(newest)
        return dropped

    def peek_stamp(self) -> int | None:
        """Stamp of the oldest sample; None if there is none or its run is malformed."""
        if not self.runs or self.offset + RECORD_HEAD_BYTES > len(self.runs[0].body):
            return None
        stamp_ns: int = _unpack_record(self.runs[0].body, self.offset)[1]
        return stamp_ns

    def pop_frame(self) -> tuple[Buffer, ...]:
        """Take the rest of the oldest run, as the header and the body (or its pieces) of a frame to
        `endpoint`."""
        run = self.runs[0]
        held = run.count - self.skipped
        body: Buffer = run.body
        if self.offset:
            body = memoryview(body)[self.offset :]
        head = DATA_HEAD.pack(
            _OVERHEAD_BYTES + len(body),
            DATA,
            (REPLAY if run.is_replay else 0) | (RESUMED if run.is_resumed else 0),
            0,
            self.endpoint,
            run.source,
            run.first_seq + self.skipped,
            held,
            0,
        )
        pieces = () if self.offset else run.pieces
        self.forget_head()
        return (head, *pieces) if pieces else (head, body)

    def advance(self, count: int, offset: int) -> None:
        """Use up `count` more samples of the oldest run; `offset` is behind them."""
        run = self.runs[0]
        if self.skipped + count == run.count:
            self.forget_head()
        else:
            self.offset = offset
            self.skipped += count
            self.count -= count

    def clear(self) -> int:
        """Drop everything; returns the number of samples dropped."""
        return self.drop(self.count)

    def newest(self, count: int, after_seq: int) -> Iterator[Run]:
        """Replays of the newest `count` samples (0: of all) with numbers above `after_seq`.

        Only for a queue with the samples of one publisher.
        """
        surplus = max(0, self.count - count) if count else 0
        offset, skipped = self.offset, self.skipped
        for run in self.runs:
            held = run.count - skipped
            first_seq = run.first_seq + skipped
            seen = min(held, max(surplus, after_seq + 1 - first_seq))
            if seen < held:
                offset, _ = run.cut_at(skipped + seen, skipped, offset)
                body = memoryview(run.body)[offset:]
                replay = Run(0, run.source, first_seq + seen, held - seen, body, is_replay=True)
                replay.lifespan_ns = run.lifespan_ns
                yield replay
            surplus = max(0, surplus - held)
            offset = skipped = 0

    def _skip(self, run: Run, count: int) -> None:
        self.offset, self.steps = run.cut_at(self.skipped + count, self.skipped, self.offset)
        self.skipped += count
        self.count -= count

    def forget_head(self) -> None:
        """Remove the oldest run, which is used up or dropped."""
        run = self.runs.popleft()
        self.count -= run.count - self.skipped
        size = len(run.body) + RUN_COST_BYTES
        self.held_bytes -= size
        account = self.account
        account.used -= size
        parent = account.parent
        if parent is not None:
            parent.used -= size
        self.offset = self.skipped = 0
        if not self.runs:
            self.bound = self.depth or UNBOUNDED

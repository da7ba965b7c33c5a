"""Runs of samples, and the one bounded queue of the bus.

A `Run` is what a data frame carries. A `RunQueue` holds the runs that wait at one of three places: at a
publisher (to be handed over), in the broker (to be sent to one subscription) and in a subscription (to be
taken). It counts samples, not runs, and drops the oldest first; the caller learns how many went.

Cost: pushing and popping a run is O(1) whatever the number of samples in it; trimming walks the samples that
it drops. Knows no I/O and no clock.
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
"""What it costs to hold a run besides its body, about. Charged too: small runs are mostly that."""

UNBOUNDED = 1 << 62
_OVERHEAD_BYTES = DATA_HEAD_BYTES - LENGTH_BYTES


class Run(msgspec.Struct, eq=False, gc=False):
    """Samples of one publisher with consecutive sequence numbers, shared by all queues that it waits in.

    `body` is `count` records back to back. A replay carries samples that were published before the
    subscription was there; they don't count against its depth. (A msgspec Struct, because one is made for
    each frame, and it is made in C.)
    """

    endpoint: int
    source: int
    """The publisher; 0 on the way to the broker, where `endpoint` is the publisher."""
    first_seq: int
    count: int
    body: Buffer
    is_replay: bool = False
    lifespan_ns: int = 0
    """The publisher's; 0 = for ever."""
    received_ns: int = 0
    """When the subscription's process got the run; monotonic clock."""
    origin: object = None
    """The subscription's knowledge of the publisher."""
    is_resumed: bool = False
    """The numbers missing before it went by another route and are not lost."""
    only_for: int = 0
    """On the way to the broker: the one subscription that it is for; 0: all that are routed."""
    newest_ns: int | None = None
    """The latest stamp in it; None: not read yet. All queues that it waits in share it."""

    def after(self, seq: int) -> "Run":
        """What is left behind number `seq`, which is one of its own and not the last."""
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
        """Whether the records fill the body, no more and no less. Costs a step for each sample."""
        offset, size = 0, len(self.body)
        for _ in range(self.count):
            if offset + RECORD_HEAD_BYTES > size:
                return False
            offset += RECORD_HEAD_BYTES + _unpack_record(self.body, offset)[0]
        return offset == size

    def records(self) -> Iterator[tuple[memoryview, int]]:
        """Each payload with its stamp; stops early where the body is shorter than it claims."""
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
    """The header of a data frame towards the broker; `only_for`: one subscription."""
    size = _OVERHEAD_BYTES + body_bytes
    return DATA_HEAD.pack(size, DATA, flags, 0, endpoint, only_for, first_seq, count, 0)


def _walk(body: Buffer, offset: int, count: int) -> int:
    """The offset `count` records on; the end of the body where it is shorter than it claims."""
    for _ in range(count):
        if offset + RECORD_HEAD_BYTES > len(body):
            break
        offset += RECORD_HEAD_BYTES + _unpack_record(body, offset)[0]
    return min(offset, len(body))


def _newest_stamp(body: Buffer, count: int) -> int:
    """The latest stamp of the `count` records in `body`; stops early where it is shorter than it claims."""
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
    """How many of the `count` records from `offset` on are older than `limit_ns`, up to the first that is
    not, and the offset of that one. Where the body is shorter than it claims, all of them."""
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
    """What one holder keeps of a resource, in bytes, and how much it may keep.

    What is charged to it is charged to its `parent` too: what some holders may keep together.
    """

    __slots__ = ("limit", "parent", "used")

    def __init__(self, limit: int, parent: "Account | None" = None) -> None:
        self.limit = limit
        self.parent = parent
        self.used = 0

    def charge(self, size: int) -> None:
        """Add `size` bytes, or release where it is negative. Hot paths inline this."""
        self.used += size
        if self.parent is not None:
            self.parent.used += size

    @property
    def is_over(self) -> bool:
        """More is kept than may be."""
        return self.used > self.limit


class RunQueue:
    """A first-in first-out queue of samples, bounded by `depth` samples (0: not bounded by number).

    `endpoint` is what the frames made from it are addressed to. Bytes held are charged to `account`.
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
    )

    def __init__(self, depth: int, account: Account, endpoint: int = 0) -> None:
        self.account = account
        self.depth = depth
        # How many samples may be held: the depth, and room for replayed ones until the queue is empty again.
        self.bound = depth or UNBOUNDED
        self.endpoint = endpoint
        self.runs: deque[Run] = deque()
        self.rest: deque[Run] = deque()  # dropped, and yet to be freed
        self.count = 0
        self.held_bytes = 0  # of the runs that are held, and what it costs to hold them
        # The head run may have been used up in part: bytes and samples of it that are gone.
        self.offset = 0
        self.skipped = 0
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
        """Whether it exceeds its depth, or its account a limit."""
        account = self.account
        is_over = account.is_over or (account.parent is not None and account.parent.is_over)
        return is_over or self.count > self.bound

    def trim(self) -> int:
        """Drop the oldest samples beyond the depth; returns how many."""
        return self.drop(self.count - self.bound) if self.count > self.bound else 0

    def push(self, run: Run) -> int:
        """Append `run`; returns how many of the oldest samples were replaced because of the depth."""
        return self.trim() if self.append(run) else 0

    def drop(self, count: int) -> int:
        """Drop the `count` oldest samples; returns how many went (less only where fewer were held)."""
        left = count
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
        """Drop samples from the head that are older than their publisher's lifespan; returns how many.

        Runs of which nothing is left are added to `gone`.
        """
        dropped = 0
        while expired := self.drop_expired_of_head(now_ns, gone):
            dropped += expired
        return dropped

    def drop_expired_of_head(self, now_ns: int, gone: list[Run] | None = None) -> int:
        """The same for the oldest run alone: so a caller bounds the work by runs.

        A run that has expired as a whole goes in one step, but for the first of the queues that it waits in,
        which reads its stamps.
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

        `account`: its parent may be meant instead; `slack`: how far below the limit to go. The `spare` newest
        runs stay in any case. Those that go are added to `gone`. If `most` (0: no limit) went and that is not
        enough, all but those go, in one step, and are left in `rest` for the caller to free.
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
        """Drop all runs but the `spare` newest (1 or 0); returns the samples dropped."""
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

    def pop_frame(self) -> tuple[bytes, Buffer]:
        """Take what is left of the oldest run, as the header and the body of a frame to `endpoint`."""
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
        self.forget_head()
        return head, body

    def advance(self, count: int, offset: int) -> None:
        """The first `count` samples of what is left of the oldest run are used up; `offset` is after them."""
        run = self.runs[0]
        if self.skipped + count == run.count:
            self.forget_head()
        else:
            self.offset = offset
            self.skipped += count
            self.count -= count

    def clear(self) -> int:
        """Drop everything; returns how many samples went."""
        return self.drop(self.count)

    def newest(self, count: int, after_seq: int) -> Iterator[Run]:
        """Replays of the newest `count` samples (0: of all) whose number is above `after_seq`.

        Only for a queue with the samples of one publisher.
        """
        surplus = max(0, self.count - count) if count else 0
        offset, skipped = self.offset, self.skipped
        for run in self.runs:
            held = run.count - skipped
            first_seq = run.first_seq + skipped
            seen = min(held, max(surplus, after_seq + 1 - first_seq))
            if seen < held:
                offset = _walk(run.body, offset, seen)
                body = memoryview(run.body)[offset:]
                replay = Run(0, run.source, first_seq + seen, held - seen, body, is_replay=True)
                replay.lifespan_ns = run.lifespan_ns
                yield replay
            surplus = max(0, surplus - held)
            offset = skipped = 0

    def _skip(self, run: Run, count: int) -> None:
        self.offset = _walk(run.body, self.offset, count)
        self.skipped += count
        self.count -= count

    def forget_head(self) -> None:
        """The oldest run is used up or dropped."""
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

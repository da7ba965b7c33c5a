"""The native core: whole operations on mapped segments. See docs/ring.md; the algorithm is in the headers."""

import builtins
from collections.abc import Callable, Coroutine, Sequence, Sized
from types import MemberDescriptorType
from typing import Any, Final, Generic, Literal, TypeAlias, TypeVar

M = TypeVar("M")
S = TypeVar("S")
Buffer: TypeAlias = Any
Bytes: TypeAlias = bytes

REPORT_DUE: Final = 2
"""Written, and it was the first since `is_report_due` was set to False."""
FULL: Final = 3
"""Not written: a lossless reader, or `hold`, has not passed what would be overwritten."""
SHORT: Final = 4
"""Not written: fewer than the newest `keep` records would be left."""
PINNED: Final = 5
"""Not written: pinned records leave no room."""
TOO_LARGE: Final = 6
"""Not written: more than `max_payload` or `most`."""
WRONG_THREAD: Final = 7
"""Not written: the thread that calls may not use the writer now."""
HELD: Final = 8
"""Not written: `hold` may be out of date; said once for a record. Move it if so, and try again."""

AS_TEXT: Final = 1
AS_FLOAT: Final = 2
AS_BOOL: Final = 3
AS_INT: Final = 4
AS_STRUCT: Final = 5
AS_BYTES: Final = 6
AS_LIST: Final = 7
"""How a Plan encodes a value."""

def ring_bytes(capacity: int, index_length: int) -> int:
    """Bytes of a ring's segment; 0 where a size is no power of two or out of bounds."""

def readers_bytes(slot_count: int) -> int: ...

class Mapping:
    """`size` bytes of a descriptor, mapped; unmapped when the last that uses it is gone. Raises OSError."""

    size: int
    def __init__(self, descriptor: int, size: int, *, writable: bool = False) -> None: ...
    def format_ring(self, capacity: int, index_length: int, first_seq: int) -> None:
        """Lay an empty ring into a new, zeroed segment. Raises ValueError for sizes out of bounds."""
    def format_readers(self, slot_count: int) -> None: ...

class Bell:
    """Another process's readers' segment and doorbell, as the writers that wake it know them.

    Raises ValueError, saying what is wrong, where `memory` is no readers' segment. The caller keeps
    `doorbell` open.
    """

    def __init__(self, memory: Mapping, doorbell: int) -> None: ...

class Plan:
    """How to check and encode the messages of one class in one pass; made by `bus.types.check.plan`.

    A field: where it stands, the bytes before its value, the value. A value: how it is encoded (AS_...), the
    least and the most it may be (AS_INT) or its length may (AS_BYTES, AS_LIST), and of what it is: a Plan
    (AS_STRUCT), the value of each item (AS_LIST).
    """

    def __init__(
        self,
        kind: type,
        fields: tuple[tuple[MemberDescriptorType, Bytes, tuple[int, int, int, Any]], ...],
        is_array: bool,
    ) -> None: ...
    def encode(self, message: Any, /) -> Bytes | None:
        """What the encoder would give; None where the message is not just as planned: go the long way."""

    decode_slowly: Callable[[Any], Any]
    """The long way of `decode`. May be set, where `kind` is no Struct."""
    def decode(self, payload: Any, /) -> Any:
        """The message, made by no constructor and no setter. Where the bytes are not just as planned, what
        `decode_slowly` gives or raises; TypeError where there is none.
        """

class Sends:
    """What gives a publisher's `send` where there is room, with no coroutine.

    `go_on(message, status)` takes over where `publish` gave neither True nor False, and says whether the
    message is taken. Where it is not, `slow(message)` gives the coroutine that does all.
    `forgotten(message)` is called where what `send` gave is never awaited.
    """

    publish: Callable[[Any], Any]
    """The quick way at present: True: the message is taken; False: nothing was done. May be set."""
    spares_turns: bool
    """After 100 messages the event loop gets a turn only where it has had none for 0.2 ms. May be set."""

    def __init__(
        self,
        slow: Callable[[Any], Coroutine[Any, Any, None]],
        go_on: Callable[[Any, Any], bool],
        forgotten: Callable[[Any], object],
    ) -> None: ...
    def send(self, message: Any, /) -> Coroutine[Any, Any, None]: ...
    def share(self, loop: Any, rest: Callable[[Any, Any], None], /) -> None:
        """Threads share `loop`, which has a `guard` and `is_interrupted`: see `publish_shared`. Once."""

    def publish_shared(self, message: Any, /) -> None:
        """`publish` under the loop's guard. `rest(message, status)`, without it, does what that leaves to do.

        `status`: as `publish` gave it; None where nothing was tried: another thread has the guard, or there
        is no quick way; True where the message is taken, and only an interrupt is left.
        """

class Writer:
    """A publisher's end of its ring, for the thread that made it; `memory` is its own, formatted."""

    capacity: int
    latest: int
    oldest: int
    samples: int
    """Published by this writer, in all its rings."""
    bytes: int
    keep: int
    """Newest records that must stay. May be set."""
    hold: int
    """Nothing from this seq on may be given up, as for a lossless reader there; 0: no matter. May be set."""
    most: int
    """Largest payload that may be published, whatever the ring holds: beyond, TOO_LARGE. May be set;
    1 << 62 at first."""
    is_mine: Callable[[], bool] | None
    """May be set: any thread may write for which that is true, as where it holds a lock."""
    is_report_due: bool
    """May be set to False: then the next write returns REPORT_DUE once."""
    is_long: bool
    """`publish` took a message that was longer than `longest`: it takes no more until this is False."""
    longest: int
    is_lent: bool
    """From `lend` to `publish_lent`: `publish` takes nothing. May be set to False: it was given back."""

    def __init__(self, memory: Mapping, keep: int) -> None: ...
    def write(self, payload: Buffer, /) -> bool | int:
        """Stamp `payload`, publish it and wake readers that sleep. True, or one of the numbers above. False:
        it is longer than 64 KiB, or `is_lent` is set."""
    def prepare(
        self,
        kind: type,
        is_valid: Callable[[Any], bool],
        encode: Callable[[Any], builtins.bytes],
        plan: Plan | None = None,
        /,
    ) -> None:
        """What `publish` is to publish. Raises ValueError the second time."""
    def publish(self, message: Any, /) -> bool | int:
        """Check, encode and `write` a message, in one pass where it is as planned. False: it is none of that
        kind, not surely valid, can't be encoded, or `is_long` or `is_lent` is set. Else as `write`."""
    def write_parts(
        self, parts: Sequence[Buffer | str], /, *, force: bool = False, stamp_ns: int = 0
    ) -> Literal[True] | int:
        """As `write`, one record of the parts back to back, text as UTF-8.

        `force` gives up depth instead of SHORT.
        """
    def publish_packed(self, data: Buffer, start: int, /) -> tuple[int, bool]:
        """Publish the records of a pack (see `scan_packed`) from `start` on, each with its time, as far as
        that is simple: how many, and whether the counters are to be reported (REPORT_DUE)."""
    def lend(self, size: int, *, force: bool = False) -> memoryview | int:
        """A place for a payload of `size` bytes, to be filled and published; or why there is none.

        Another write takes it back: then `publish_lent` says so.
        """
    def lend_field(
        self, message: Any, index: int, size: int, make: Callable[[memoryview, S], M], end: S, /
    ) -> M | bool | int:
        """As `publish`, but for `size` bytes that are to be the field `index` of `message`.

        What `make` makes of their place and `end`; where that raises, nothing is lent.
        """
    def lent(self) -> memoryview:
        """The place of the whole payload that is lent; empty where nothing is."""
    def publish_lent(self) -> Literal[True] | int:
        """Publish what was lent. Raises ValueError where nothing is lent any more. TOO_LARGE: still lent."""
    def since(self, stamp_ns: int) -> list[tuple[int, int, Bytes]]:
        """The newest records stamped at or after `stamp_ns`, oldest first: seq, stamp, payload."""
    def seq_since(self, stamp_ns: int) -> int:
        """The number of the first record that `since` gives; latest + 1 where it gives none."""

    def add_gate(self, key: int, bell: Bell, slot: int, *, is_lossless: bool) -> None:
        """A match: its reader shows its position in `slot`. Wakes it where it sleeps.

        From now on the reader may pin records. An existing key is replaced. Raises ValueError for a slot
        beyond the segment.
        """
    def remove_gate(self, key: int) -> None: ...
    def has_pins(self, key: int) -> bool: ...
    def make_lossy(self, key: int) -> None: ...
    def wait_for_room(self) -> bool:
        """After FULL: announce the sleep. True: the doorbell will ring; False: try again at once."""
    def woken(self) -> None:
        """Take the announcement back."""

    def carry_from(self, count: int) -> int:
        """The seq from which on the newest `count` records are carried to a next ring, its first_seq."""
    def move(self, memory: Mapping) -> None:
        """Go on in another ring, formatted with `carry_from()`: carries the records from there on, closes the
        old one and wakes all readers. Gates stay; a wait for room ends. Raises ValueError, changing nothing,
        where it does not fit."""
    def close(self) -> None:
        """Nothing more will be written: the ring itself says so, and readers are woken."""
    def _debug(self) -> dict[str, int]:
        """For tests. `lossless`: gates; `rung`: doorbells so far; `taken`: everything before this seq was
        taken by all lossless readers, `hold` apart; latest + 1 without any, and at most."""

class Readers:
    """This process's readers' segment (`memory`, formatted) and doorbell (`doorbell`, an eventfd)."""

    has_writers: bool
    """Writers wait for room by the same doorbell. May be set."""
    def __init__(self, memory: Mapping, doorbell: int) -> None: ...
    def deliver(self, may_sleep: bool, /) -> list[Any] | None:
        """The doorbell rang: disarm, and give each reader with news its turn; then read the doorbell.

        A reader that was prepared and may call back takes one message and does. Where the others and those
        with more are none, and it may, this falls asleep: then None, as when it was closed. Else the owners
        that must look, perhaps none, and it is awake. An exception of a callback that is no Exception comes
        out of here, and the doorbell rings: what is left to do, the next call does.
        """
    def sleep(self, spin_ns: int = 0) -> list[Any]:
        """Look for up to `spin_ns` for news; else arm the bell and look again. [] = asleep; else the owners
        of readers for whom something has come since the last look.

        What `attach` and `extend` find is news to the next `deliver`, `sleep` or `look`: do one of them
        after.
        """
    def look(self, spin_ns: int) -> list[Any] | None:
        """Look for up to `spin_ns` for news, without arming the bell (busy polling); give turns as `deliver`.

        None: nothing has come. Else the owners that must look, perhaps none.
        """
    def is_free(self, slot: int) -> bool:
        """No pin of this slot is in use."""
    def close(self) -> None:
        """The doorbell is not ours from now on: `deliver` leaves it alone and ends, wherever it is."""

class Reader(Generic[S]):
    """What one subscription reads: the rings of its publishers, merged by their stamps.

    `depth` (0: none) bounds what may wait over all rings: the oldest beyond are passed over and counted. May
    be set. `tells_cursor`: publishers are to know what was taken (keep all).
    """

    depth: int
    samples: int
    bytes: int
    replaced: int
    overrun: int
    expired: int
    undecodable: int
    is_busy: bool
    """A call is under way or about to go on, so that it must not call back by itself. May be set."""
    is_report_due: bool
    """May be set to False: the counters were reported, and change once more. Code that reports the change
    sets it."""
    takes_held: bool
    """Whether what is held is taken all the same. May be set."""
    expected: int
    """By the numbers: samples + replaced + overrun + expired + undecodable + those that wait."""

    def __init__(self, readers: Readers, owner: Any, depth: int, *, tells_cursor: bool) -> None: ...
    def attach(
        self,
        source: S,
        memory: Mapping,
        slot: int,
        *,
        start: int = 0,
        since_ns: int = 0,
        history: int = 0,
        lifespan_ns: int = 0,
        clock_ns: int = 0,
        doorbell: int = -1,
    ) -> int:
        """Read a ring from `start` on; or (0) from `history` records before the first that is stamped at or
        after `since_ns` (that is latest + 1 where none is), never from before its oldest. Returns the first
        seq.

        `slot` must be free (`Readers.is_free`), and its cursor is set. Until the publisher has added its
        gate, large records are copied and not pinned; so allot slots in turn, not the one given back last.
        `since_ns` is of our clock; `clock_ns`: what the writer's, which stamps, is ahead of it.
        `doorbell` is the publisher's, rung where it waits for room; the caller keeps it open. Raises
        ValueError, saying what is wrong, where `memory` is no ring, and where `source` is attached already.
        """
    def extend(self, source: S, memory: Mapping) -> None:
        """The ring in which `source` goes on after the present one is closed and taken to its end.

        A closed ring without a next one is kept (the next is on its way), until `finish`. Raises ValueError
        as `attach`, and where `source` is not attached.
        """
    def finish(self, source: S) -> None:
        """Its publisher has gone: what is there may still be taken, then the ring is left (`pop_left`)."""
    def detach(self, source: S) -> None:
        """Leave a ring at once. Nothing happens where it is not attached."""
    def hold(self, source: S, is_on: bool, /) -> None:
        """Leave what `source` publishes in its ring, which fills, so that a lossless one waits; or go on.

        Nothing happens where it is not attached.
        """
    def next_seq(self, source: S) -> int:
        """The number that is taken next; 0 where it is not attached."""
    def prepare(
        self,
        callback: Callable[[Any], object],
        decode: Callable[[Any], M],
        on_error: Callable[[Exception], object],
        queues: tuple[Sized, ...],
        on_report_due: Callable[[], object],
        on_slow: Callable[[int], object] | None = None,
        gives_taken: bool = False,
    ) -> None:
        """Let `Readers.deliver` call back, while all `queues` are empty: what waits there comes first.

        With `gives_taken` the callback gets a message as `take` returns it.

        Before a message for which `is_report_due` is False it calls `on_report_due`, and sets it. After a
        call that has taken 0.2 s or longer it calls `on_slow` with its nanoseconds.
        """
    def forget_callback(self) -> None:
        """Take that back, also while it is called."""
    def waiting(self) -> int:
        """Samples that could be taken now, within the depth."""
    def take(self, limit: int, decode: Callable[[Any], M]) -> list[tuple[M, int, int, S, int]]:
        """Up to `limit` messages: (message, stamp ns, seq, source, time of taking in ns). A stamp below 0 is
        the time that the source gave: see `bus.delivery.receiver.Taken`.

        A batch ends early once it has 256 KiB of payload.
        """
    def messages(self, limit: int, decode: Callable[[Any], M]) -> list[M]:
        """As `take`, the messages alone."""
    def take_packed(
        self, most_bytes: int, longest: int, offset_ns: int, /
    ) -> tuple[S, Bytes, int, int, int, bool, bool] | None:
        """What waits of the source whose sample is the oldest, packed (see `scan_packed`) into `most_bytes`
        at most, up to the first sample of `longest` bytes or more; None where there is nothing.

        Source, pack, samples, bytes of payload, where the last record begins, whether numbers are
        consecutive, whether more waits. `offset_ns` makes the wall clock's time of a stamp.
        """
    def wait(
        self,
        decode: Callable[[Any], M],
        has_origin: bool,
        epoll: int,
        deadline_ns: int,
        due_s: float,
        /,
    ) -> M | tuple[M, int, int, S, int] | None:
        """Sleep until a message comes: the oldest one, with `has_origin` as `take` gives it. Gives the GIL
        away.

        None: at `deadline_ns` and at `due_s` (0: never), and wherever else the event loop is to have a turn,
        or Python to look: `epoll` has other events than the doorbell, another reader has news,
        `is_report_due` is not set, a sample was refused, nothing is attached, signals were handled, all was
        found without a sleep for a while. What has to be done then is still there to be found. Raises what
        `decode` raises that is no Exception, and what a signal's handler raises.
        """
    def pop_rejected(self) -> list[tuple[int, Exception]]:
        """Size and error of the samples that `decode` refused since the last call."""
    def pop_ages(self) -> tuple[int, int, int]:
        """Ages of samples taken since the last call, in ns: of how many, their sum, the highest."""
    def pop_left(self) -> list[tuple[S, str, int]]:
        """Sources whose ring the reader has left by itself, the reason ("": it was finished), and the next
        number."""

class OpenRun:
    """`bus.delivery.open_run.OpenRun`, which says what it does."""

    samples: int
    size: int
    budget: int
    most: int
    begins_below: int
    thread: int
    is_mine: Callable[[], bool] | None
    def __init__(self) -> None: ...
    def add(self, payload: Buffer, stamp_ns: int = 0, /) -> bool: ...
    def begin(self, payload: Buffer, stamp_ns: int, /) -> None: ...
    def end(self, endpoint: int, first_seq: int, flags: int, /) -> bytearray: ...
    def forget(self) -> None: ...
    def prepare(
        self,
        kind: type,
        is_valid: Callable[[Any], bool],
        encode: Callable[[Any], Bytes],
        plan: Plan | None,
        /,
    ) -> None: ...
    def begin_by(
        self, begun: Callable[[int], object], may_begin: Callable[[int], bool] | None, /
    ) -> None: ...
    def publish(self, message: Any, /) -> bool | Bytes: ...
    def write(self, payload: Buffer, /) -> bool: ...

def run_messages(
    body: Buffer, offset: int, number: int, decode: Callable[[Any], M], /
) -> tuple[list[M], int] | None:
    """`number` messages of a run's body from `offset` on, and the offset behind them.

    None where one of them is cut off, or `decode` refuses it.
    """

def run_samples(
    body: Buffer,
    offset: int,
    number: int,
    decode: Callable[[Any], M],
    first_seq: int,
    source: object,
    received_ns: int,
    /,
) -> tuple[list[tuple[M, int, int, Any, int]], int] | None:
    """As `run_messages`: (message, stamp ns, seq, source, time of receipt in ns) in place of each message."""

def scan_packed(data: Buffer, start: int, limit: int, /) -> tuple[int, int, int, int, int, bool]:
    """What `bus_bridge.packed.scan` says."""

def keep_thread() -> None:
    """Keep Python's state of the calling thread, which Python has not made, until that ends.

    Else Python makes it anew for each call from there, and maps memory for it.
    """

def forget_pins() -> None:
    """In the child of a fork: views that it inherited must not release the parent's pins."""

def timerfd_create() -> int:
    """A new descriptor: a timer of the monotonic clock, non-blocking and not inherited. Raises OSError."""

def timerfd_settime(descriptor: int, due_ns: int, /) -> None:
    """Make it readable once the monotonic clock shows `due_ns`, and not before; 0: never."""

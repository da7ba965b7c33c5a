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
"""Not written: it would overwrite records that a lossless reader has not taken, or that `hold` protects."""
SHORT: Final = 4
"""Not written: fewer than the newest `keep` records would be left."""
PINNED: Final = 5
"""Not written: pinned records leave no room."""
TOO_LARGE: Final = 6
"""Not written: the payload is above `max_payload` or `most`."""
WRONG_THREAD: Final = 7
"""Not written: the calling thread may not use the writer now."""
HELD: Final = 8
"""Not written: `hold` may be out of date; returned once for a record. Move it if so, and try again."""

AS_TEXT: Final = 1
AS_FLOAT: Final = 2
AS_BOOL: Final = 3
AS_INT: Final = 4
AS_STRUCT: Final = 5
AS_BYTES: Final = 6
AS_LIST: Final = 7
"""How a Plan encodes a value."""

def ring_bytes(capacity: int, index_length: int) -> int:
    """Bytes of a ring's segment; 0 if a size is no power of two or out of bounds."""

def readers_bytes(slot_count: int) -> int: ...
def next_ring(
    capacity: int, held: int, size: int, keep: int, most: int, *, keeps_all: bool, must: bool
) -> tuple[int, int] | None:
    """Capacity and index length of the ring after one that holds `held` records; None: it must not grow.

    `size`: a message that must fit; `keep`: records that must stay; `most`: limit, unless it `must` grow.
    """

def is_filled_by_few(capacity: int, held: int) -> bool:
    """Whether a larger ring lets both sides work at the same time, because few long records fill this one."""

class Mapping:
    """`size` mapped bytes of a descriptor; unmapped when its last user is gone. Raises OSError."""

    size: int
    def __init__(self, descriptor: int, size: int, *, writable: bool = False) -> None: ...
    def format_ring(self, capacity: int, index_length: int, first_seq: int) -> None:
        """Format a new, zeroed segment as an empty ring. Raises ValueError for sizes out of bounds."""
    def format_readers(self, slot_count: int) -> None: ...

class Bell:
    """Another process's readers' segment and doorbell, for the writers that wake it.

    Raises ValueError with the fault if `memory` is no readers' segment. The caller keeps `doorbell` open.
    """

    def __init__(self, memory: Mapping, doorbell: int) -> None: ...

class Plan:
    """Checks and encodes the messages of one class in one pass; made by `bus.types.check.plan`.

    A field is a tuple: its member descriptor, the bytes before its value, the value's plan. The plan of a
    value is a tuple, too: its encoding (AS_...); the least and the highest number (AS_INT) or length
    (AS_BYTES, AS_LIST); a Plan (AS_STRUCT) or the plan of each item (AS_LIST).
    """

    def __init__(
        self,
        kind: type,
        fields: tuple[tuple[MemberDescriptorType, Bytes, tuple[int, int, int, Any]], ...],
        is_array: bool,
    ) -> None: ...
    def encode(self, message: Any, /) -> Bytes | None:
        """The encoder's bytes; None if the message differs from the plan: go the long way."""

    decode_slowly: Callable[[Any], Any]
    """The long way of `decode`. May be set, if `kind` is no Struct."""
    def decode(self, payload: Any, /) -> Any:
        """The message, made without its constructor and setters.

        If the bytes differ from the plan, the result or the error of `decode_slowly`; without one, TypeError.
        """

class Sends:
    """A publisher's `send` without a coroutine, if there is room.

    If `publish` returns neither True nor False, `go_on(message, status)` takes over and returns whether the
    message is taken. If it is not, `slow(message)` makes a coroutine that does everything. If the result of
    `send` is never awaited, `forgotten(message)` is called.
    """

    publish: Callable[[Any], Any]
    """The present quick way. True: the message is taken; False: nothing was done. May be set."""
    slow: Callable[[Any], Coroutine[Any, Any, None]]
    """May be set."""
    spares_turns: bool
    """After 100 messages the event loop gets a turn only if it has had none for 0.2 ms. May be set."""

    def __init__(
        self,
        slow: Callable[[Any], Coroutine[Any, Any, None]],
        go_on: Callable[[Any, Any], bool],
        forgotten: Callable[[Any], object],
    ) -> None: ...
    def send(self, message: Any, /) -> Coroutine[Any, Any, None]: ...
    def share(self, loop: Any, rest: Callable[[Any, Any], None], /) -> None:
        """Let threads share `loop`, which has a `guard` and `is_interrupted`: see `publish_shared`. Once.

        With None as `loop` there is no guard: only the thread of the event loop publishes.
        """

    def publish_shared(self, msg: Any) -> None:
        """`publish` under the loop's guard. Then `rest(msg, status)`, without the guard, does the rest.

        `status` is the result of `publish`. None: nothing was tried, because another thread has the guard, or
        there is no quick way. True: the message is taken, and only an interrupt remains.
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
    """No record from this seq on may be dropped, as with a lossless reader there; 0: no limit. May be set."""
    most: int
    """Largest payload that may be published, whatever the ring holds; above it, TOO_LARGE. May be set;
    1 << 62 at first."""
    is_mine: Callable[[], bool] | None
    """May be set: then any thread for which it returns True may write, for example one with a lock."""
    is_report_due: bool
    """May be set to False: then the next write returns REPORT_DUE once."""
    is_long: bool
    """`publish` took a message longer than `longest`: it takes no more until this is set to False."""
    longest: int
    most_long: int
    """Longest field that `publish` takes from 64 KiB on, without an encoding of the whole; 0 at first. It
    returns False for a longer one. May be set."""
    plans_only: bool
    """`publish` takes only messages that agree with the plan. May be set."""
    is_lent: bool
    """True from `lend` to `publish_lent`: `publish` takes nothing. May be set to False to end the loan."""

    def __init__(self, memory: Mapping, keep: int) -> None: ...
    def write(self, payload: Buffer, /) -> bool | int:
        """Stamp `payload`, publish it and wake sleeping readers.

        True, or one of the numbers above. False: it is longer than 64 KiB, or `is_lent` is set.
        """
    def prepare(
        self,
        kind: type,
        is_valid: Callable[[Any], bool],
        encode: Callable[[Any], builtins.bytes],
        plan: Plan | None = None,
        /,
    ) -> None:
        """Set the class of messages that `publish` takes. Raises ValueError the second time."""
    def publish(self, message: Any, /) -> bool | int:
        """Check, encode and `write` a message, in one pass if it agrees with the plan.

        False: it has another class, may be invalid, can't be encoded, or `is_long` or `is_lent` is set. Else
        as `write`.
        """
    def write_parts(
        self, parts: Sequence[Buffer | str], /, *, force: bool = False, stamp_ns: int = 0
    ) -> Literal[True] | int:
        """As `write`, for one record of the parts back to back, text as UTF-8.

        `force` gives up depth instead of returning SHORT.
        """
    def publish_packed(self, data: Buffer, start: int, /) -> tuple[int, bool]:
        """Publish the records of a pack (see `scan_packed`) from `start` on, each with its time.

        Ends at a record that needs the slow way. Returns how many were published, and whether the counters
        must be reported (REPORT_DUE).
        """
    def lend(self, size: int, *, force: bool = False) -> memoryview | int:
        """Lend a place for a payload of `size` bytes, to be filled and published; or the reason of a failure.

        Another write ends the loan: then `publish_lent` raises ValueError.
        """
    def lend_field(
        self, message: Any, index: int, size: int, make: Callable[[memoryview, S], M], end: S, /
    ) -> M | bool | int:
        """As `publish`, but lends a place for `size` bytes, the field `index` of `message`.

        Returns the result of `make` for that place and `end`. If `make` raises, nothing is lent.
        """
    def lent(self) -> memoryview:
        """The place of the whole lent payload; empty if there is no loan."""
    def publish_lent(self) -> Literal[True] | int:
        """Publish the lent payload. Raises ValueError if the loan has ended. TOO_LARGE: still lent."""
    def since(self, stamp_ns: int) -> list[tuple[int, int, Bytes]]:
        """The newest records stamped at or after `stamp_ns`, oldest first: seq, stamp, payload."""
    def seq_since(self, stamp_ns: int) -> int:
        """The number of the first record of `since`; latest + 1 if there is none."""

    def add_gate(self, key: int, bell: Bell, slot: int, *, is_lossless: bool) -> None:
        """Add a match, whose reader shows its position in `slot`. Wakes the reader if it sleeps.

        From now on the reader may pin records. An existing key is replaced. Raises ValueError for a slot
        outside the segment.
        """
    def remove_gate(self, key: int) -> None: ...
    def has_pins(self, key: int) -> bool: ...
    def make_lossy(self, key: int) -> None: ...
    def wait_for_room(self) -> bool:
        """After FULL: announce the sleep. True: the doorbell will ring; False: try again at once."""
    def woken(self) -> None:
        """Withdraw the announcement."""

    def carry_from(self, count: int) -> int:
        """The first_seq of a next ring, to which the newest `count` records are carried."""
    def move(self, memory: Mapping) -> None:
        """Continue in another ring, formatted with `carry_from()`.

        Carries the records from there on, closes the old ring and wakes all readers. Gates stay; a wait for
        room ends. Raises ValueError, changing nothing, if the ring does not fit.
        """
    def close(self) -> None:
        """Close the ring, to which nothing more will be written, and wake readers."""
    def _debug(self) -> dict[str, int]:
        """Numbers for tests.

        `lossless`: gates. `rung`: doorbells so far. `taken`: all lossless readers have taken everything
        before this seq, without regard to `hold`; at most latest + 1, its value without lossless readers.
        """

class Readers:
    """This process's readers' segment (`memory`, formatted) and doorbell (`doorbell`, an eventfd)."""

    has_writers: bool
    """Whether writers wait for room by the same doorbell. May be set."""
    def __init__(self, memory: Mapping, doorbell: int) -> None: ...
    def deliver(self, may_sleep: bool, /) -> list[Any] | None:
        """After a ring: disarm, and give each reader with news its turn; then read the doorbell.

        In its turn, a reader that was prepared and may call back takes one message and calls back. Other
        readers, and readers with more messages, are left to their owners. Returns these owners, perhaps none,
        and this process is awake. If there are none, and `may_sleep`, it falls asleep and returns None. A
        closed object returns None, too. If a callback raises an exception that is no Exception, this call
        passes it on and rings the doorbell; the next call does the rest.
        """
    def sleep(self, spin_ns: int = 0) -> list[Any]:
        """Poll for news for up to `spin_ns`; then arm the bell and check again.

        Returns the owners of readers with samples that arrived since the last check; an empty list means
        asleep. Samples found by `attach` and `extend` are news to the next `deliver`, `sleep` or `look`: call
        one of these afterwards.
        """
    def look(self, spin_ns: int) -> list[Any] | None:
        """Poll for news for up to `spin_ns`, without arming the bell (busy polling); give turns as `deliver`.

        None: there is no news. Else the owners that must check, perhaps none.
        """
    def is_free(self, slot: int) -> bool:
        """Whether no pin of this slot is in use."""
    def close(self) -> None:
        """Give up the doorbell: `deliver` no longer uses it, and ends, even in the middle of a call."""

class Reader(Generic[S]):
    """Reads the rings of one subscription's publishers, merged by their stamps.

    `depth` (0: none) bounds the waiting samples of all rings together: the oldest ones above it are passed
    over and counted. May be set. `tells_cursor`: shows publishers the taken samples (keep all).
    """

    depth: int
    samples: int
    bytes: int
    replaced: int
    overrun: int
    expired: int
    undecodable: int
    is_busy: bool
    """A call is in progress or about to continue, so this must not call back by itself. May be set."""
    is_report_due: bool
    """Whether the owner has been told that the counters changed. May be set, to False after a report."""
    takes_held: bool
    """Whether held samples are taken, too. May be set."""
    expected: int
    """By sequence numbers: samples + replaced + overrun + expired + undecodable + waiting ones."""

    most_missed: int
    """The most samples of one source that were replaced between two taken ones."""

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
        """Begin to read a ring. Returns the number of the first sample.

        It reads from `start` on. If that is 0, it begins `history` records before the first one stamped at or
        after `since_ns` (before latest + 1 if there is none), but not before the oldest. `slot` must be free
        (`Readers.is_free`), and its cursor is set. Until the publisher has added its gate, large records are
        copied and not pinned. So allot slots in turn, not the one that was freed last. `since_ns` is a time
        of our clock; `clock_ns` is the lead of the writer's clock, which stamps, over ours. `doorbell` is the
        publisher's, rung if it waits for room; the caller keeps it open. Raises ValueError with the fault if
        `memory` is no ring, and if `source` is attached already.
        """
    def extend(self, source: S, memory: Mapping) -> None:
        """Append the ring in which `source` continues after the present one is closed and read to its end.

        A closed ring without a next one is kept until `finish`, because the next one will come. Raises
        ValueError as `attach`, and if `source` is not attached.
        """
    def finish(self, source: S) -> None:
        """Note that the publisher has gone: its samples may still be taken, then the ring is left
        (`pop_left`)."""
    def detach(self, source: S) -> None:
        """Leave a ring at once. Nothing happens if it is not attached."""
    def hold(self, source: S, is_on: bool, /) -> None:
        """Leave samples of `source` in its ring, so that a lossless publisher waits when it is full; or
        continue.

        Nothing happens if it is not attached.
        """
    def expect_texts(self, find: Callable[[], Plan | None], /) -> None:
        """Copy a long ASCII text, from 16 KiB on, without `decode`, which gets an empty text instead of it.

        `find` is called once, at the first long payload. Only a message of its plan that begins with such a
        text is decoded in this way.
        """
    def next_seq(self, source: S) -> int:
        """The number of the sample to take next; 0 if `source` is not attached."""
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
        """Let `Readers.deliver` call back while all `queues` are empty: samples in these come first.

        With `gives_taken` the callback gets a message as `take` returns it.

        If `is_report_due` is False before a message, it calls `on_report_due` and sets it. After a call that
        took 0.2 s or longer, it calls `on_slow` with the nanoseconds.
        """
    def forget_callback(self) -> None:
        """Undo `prepare`, even during a callback."""
    def waiting(self) -> int:
        """Samples that could be taken now, within the depth."""
    def take(self, limit: int, decode: Callable[[Any], M]) -> list[tuple[M, int, int, S, int]]:
        """Take up to `limit` messages: (message, stamp ns, seq, source, time of taking in ns).

        A stamp below 0 is the time that the source gave: see `bus.delivery.receiver.Taken`. A batch ends
        early when it has 256 KiB of payload.
        """
    def messages(self, limit: int, decode: Callable[[Any], M]) -> list[M]:
        """As `take`, but only the messages."""
    def take_packed(
        self, most_bytes: int, longest: int, offset_ns: int, /
    ) -> tuple[S, Bytes, int, int, int, bool, bool] | None:
        """Take waiting samples of the source with the oldest one, packed (see `scan_packed`); None without
        any.

        The pack has at most `most_bytes`, and ends before the first sample of `longest` bytes or more.
        Returns: source, pack, samples, bytes of payload, offset of the last record, whether numbers are
        consecutive, whether more samples wait. A stamp plus `offset_ns` is its time on the wall clock.
        """
    def take_merged(
        self, most_bytes: int, longest: int, offset_ns: int, /
    ) -> tuple[S | None, Bytes, int, int, int, bool, bool] | None:
        """As `take_packed`, for the samples of all sources in the order of their stamps. The source is None,
        and numbers are not consecutive, if there are several.
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
        """Sleep until a message comes, without the GIL.

        Returns the oldest one; with `has_origin`, as `take` does. Returns None at `deadline_ns` and at
        `due_s` (0: never), and if the event loop needs a turn:

        - `epoll` has an event other than the doorbell
        - another reader has news
        - `is_report_due` is not set
        - a sample was refused
        - no ring is attached
        - signals were handled
        - all messages for a while were found without a sleep

        The cause stays, so that the loop finds it. Raises errors of `decode` that are no Exception, and
        errors of a signal's handler.
        """
    def pop_rejected(self) -> list[tuple[int, Exception]]:
        """Size and error of the samples that `decode` refused since the last call."""
    def pop_interrupted(self) -> list[Any]:
        """Messages that the last `take` or `messages` had taken before it raised an error."""
    def pop_ages(self) -> tuple[int, int, int, tuple[int, ...]]:
        """Ages of samples taken since the last call, in ns: their number, their sum, the highest. And how
        many each part of a histogram has (`bus.base.time_parts`), up to the last one used."""
    def pop_left(self) -> list[tuple[S, str, int]]:
        """Sources whose rings the reader has left on its own decision, each with reason and next number.

        The reason is "" if the ring was finished.
        """

class OpenRun:
    """`bus.delivery.open_run.OpenRun` in C."""

    samples: int
    size: int
    budget: int
    most: int
    begins_below: int
    longest: int
    is_long: bool
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

class Parts:
    """A long sample in pieces, each where its owner has it: buffers of bytes, or text. They must not change.

    It is a buffer, too: the first use as a buffer joins the pieces, and keeps the copy.
    """

    pieces: tuple[memoryview, ...]
    """For a text, its UTF-8."""
    def __init__(self, *pieces: Buffer | str) -> None: ...
    def __len__(self) -> int:
        """Bytes of all pieces."""

    def __buffer__(self, flags: int, /) -> memoryview: ...

def room(size: int, /) -> bytearray:
    """A buffer whose contents are undefined: the caller must not pass on a byte that it has not written.

    A bytearray made by Python is filled with zeros.
    """

def run_messages(
    body: Buffer, offset: int, number: int, decode: Callable[[Any], M], /
) -> tuple[list[M], int] | None:
    """`number` messages of a run's body from `offset` on, and the offset behind them.

    None if one of them is cut off, or `decode` refuses it.
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
    """As `run_messages`: (message, stamp ns, seq, source, time of receipt in ns) instead of each message."""

def scan_packed(data: Buffer, start: int, limit: int, /) -> tuple[int, int, int, int, int, bool]:
    """Does the work of `bus_bridge.packed.scan`."""

def keep_thread() -> None:
    """Keep Python's state of the calling thread, which Python has not started, until the thread ends.

    Otherwise Python makes it anew for each call from that thread, and maps memory for it.
    """

def forget_pins() -> None:
    """In the child of a fork: make inherited views leave the parent's pins alone."""

def timerfd_create() -> int:
    """Make a timer of the monotonic clock: a non-blocking descriptor, not inherited. Raises OSError."""

def timerfd_settime(descriptor: int, due_ns: int, /) -> None:
    """Make the timer readable when the monotonic clock reaches `due_ns`, and not before; 0: never."""

class MessageField:
    """The descriptor of one field of a class that looks like rosidl's; the class has MessageBase as a base.

    A value is stored at once if there is no `check`, or if its class is `usual`, an int is in `least` to
    `most`, and a float is not above `largest` in size. All other values go to `check`, which returns the
    value to store, or raises.
    """

    __doc__: str
    def __init__(
        self,
        slot: MemberDescriptorType,
        doc: str,
        check: Callable[[Any], object] | None = None,
        usual: type | None = None,
        least: int = 0,
        most: int = 0,
        largest: float = ...,
    ) -> None: ...

class MessageFields:
    """All fields of a class, its attribute `__message_fields__`, for its constructor.

    A member is a tuple: its name, its field, its value without an argument, and whether that is a function
    that makes the value. `strange` is called with arguments that are not all in `known`.
    """

    def __init__(
        self,
        known: frozenset[str],
        strange: Callable[[dict[str, object], frozenset[str]], object],
        members: tuple[tuple[str, MessageField, Any, bool], ...],
    ) -> None: ...

class MessageBase:
    """The constructor of a class with the attribute `__message_fields__`, with keyword arguments only."""

    def __init__(self, **given: object) -> None: ...

"""The run that a publisher fills: in C if the native core exists, else in Python.

Both have the same bytes and results. Must not know topics, queues, or the receivers of a run.
"""

from collections.abc import Callable
from threading import get_ident
from time import monotonic_ns
from typing import Any, Protocol

from bus import shm
from bus.wire.layout import RECORD_HEAD, RECORD_HEAD_BYTES
from bus.wire.runs import UNBOUNDED, Buffer, data_head

__all__ = ["OpenRun", "PythonRun", "open_run"]

_pack_record = RECORD_HEAD.pack


class OpenRun(Protocol):
    """The run that a publisher fills, until it is handed over.

    It takes samples on `thread` only, or, with `is_mine`, on the thread for which that returns True.
    """

    samples: int
    """Samples in the run; 0: none is open."""
    size: int
    """Bytes of its records, with their heads."""
    budget: int
    """Bytes of records that may follow. 0 after `begin`."""
    most: int
    """The most samples of a run."""
    thread: int
    is_mine: Callable[[], bool] | None

    def add(self, payload: Buffer, stamp_ns: int = 0, /) -> bool:
        """Add a sample to the open run; False if the run has no room or none is open.

        Without a stamp, the sample is stamped now. False on another thread.
        """

    def begin(self, payload: Buffer, stamp_ns: int, /) -> None:
        """Begin a new run with a sample. Raises ValueError if a run is open."""

    def end(self, endpoint: int, first_seq: int, flags: int, /) -> Buffer:
        """End the run. Returns its frame for the broker: the head, DATA_HEAD_BYTES long, and the records."""

    def forget(self) -> None:
        """Discard the run."""

    # --- quick ways, which begin a run by themselves

    begins_below: int
    """They begin a run only with a payload that is shorter than this."""
    longest: int
    """The largest encoding for `publish`."""
    is_long: bool
    """`publish` has encoded a longer message: it takes no more until this is set to False.

    So the next long message can be encoded around its long field, which is then not copied."""

    def begin_by(self, begun: Callable[[int], object], may_begin: Callable[[int], bool] | None, /) -> None:
        """Set the calls at the beginning of a run by a quick way.

        `may_begin`, if given, is called with the size of the first sample. After this was taken, `begun` is
        called with its stamp.
        """

    def prepare(
        self, kind: type, is_valid: Callable[[Any], bool], encode: Callable[[Any], bytes], plan: Any, /
    ) -> None:
        """Set how messages of class `kind` are checked and encoded (`TypeSupport.steps`)."""

    def publish(self, message: Any, /) -> bool | bytes:
        """Check, encode and take a message; True, or False if nothing was done.

        False also after an error of the check or the encoder, and before `prepare`. If only the run has no
        room, the encoded message (bytes).
        """

    def write(self, payload: Buffer, /) -> bool:
        """Take an encoded message; False if nothing was done."""


def open_run() -> OpenRun:
    """One without samples, for this thread."""
    return shm.native.OpenRun() if shm.has_core() else PythonRun()


class PythonRun:
    """`OpenRun` in Python."""

    def __init__(self) -> None:
        self.samples = self.size = self.budget = self.begins_below = 0
        self.most = self.longest = UNBOUNDED
        self.is_long = False
        self.thread = get_ident()
        self.is_mine: Callable[[], bool] | None = None
        self._parts: list[bytes] = []  # heads and payloads in turn
        self._begun: Callable[[int], object] | None = None
        self._may_begin: Callable[[int], bool] | None = None
        self._kind: type | None = None
        self._is_valid: Callable[[Any], bool] = bool
        self._encode: Callable[[Any], bytes] = bytes

    def add(self, payload: Buffer, stamp_ns: int = 0, /) -> bool:
        if not self._has_room(len(payload)) or not self._is_home():
            return False
        self._append(payload, stamp_ns or monotonic_ns())
        return True

    def begin(self, payload: Buffer, stamp_ns: int, /) -> None:
        if self._parts:
            raise ValueError("a run is open")
        self._append(payload, stamp_ns)

    def end(self, endpoint: int, first_seq: int, flags: int, /) -> Buffer:
        head = data_head(endpoint, first_seq, self.samples, self.size, flags=flags)
        frame = b"".join([head, *self._parts])
        self.forget()
        return frame

    def forget(self) -> None:
        self._parts.clear()
        self.samples = self.size = self.budget = 0

    def begin_by(self, begun: Callable[[int], object], may_begin: Callable[[int], bool] | None, /) -> None:
        if self._begun is not None:
            raise ValueError("run has its ways already")
        self._begun, self._may_begin = begun, may_begin

    def prepare(
        self, kind: type, is_valid: Callable[[Any], bool], encode: Callable[[Any], bytes], plan: Any, /
    ) -> None:
        if self._kind is not None:
            raise ValueError("run is prepared already")
        self._kind, self._is_valid, self._encode = kind, is_valid, encode

    def publish(self, message: Any, /) -> bool | bytes:
        if type(message) is not self._kind or self.is_long or not self._is_home():
            return False
        try:
            payload = self._encode(message) if self._is_valid(message) else None
        except Exception:
            return False
        if not isinstance(payload, bytes):
            return False
        self.is_long = len(payload) > self.longest
        return self._take(payload) or payload

    def write(self, payload: Buffer, /) -> bool:
        if not self._is_home():
            return False
        if not isinstance(payload, bytes):
            view = memoryview(payload)
            if view.nbytes >= self.begins_below and not self.samples:
                return False  # before a useless copy
            payload = bytes(view)
        return self._take(payload)

    def _take(self, payload: bytes) -> bool:
        """Add a payload to the open run, or begin one with it."""
        size, may_begin = len(payload), self._may_begin
        is_asked = not self.samples and size < self.begins_below
        if is_asked and may_begin is not None and not may_begin(size):
            return False
        if self.samples:  # only now: the check, the encoder and `may_begin` may have published here
            if not self._has_room(size):
                return False
            self._append(payload, monotonic_ns())
            return True
        if self._begun is None or size >= self.begins_below:
            return False
        stamp_ns = monotonic_ns()
        self._append(payload, stamp_ns)
        self._begun(stamp_ns)
        return True

    def _is_home(self) -> bool:
        return get_ident() == self.thread if self.is_mine is None else self.is_mine()

    def _has_room(self, size: int) -> bool:
        return size + RECORD_HEAD_BYTES <= self.budget and self.samples < self.most

    def _append(self, payload: Buffer, stamp_ns: int) -> None:
        size = len(payload)
        # A buffer other than bytes may change before the run leaves.
        self._parts += (
            _pack_record(size, stamp_ns),
            payload if isinstance(payload, bytes) else bytes(payload),
        )
        self.size += RECORD_HEAD_BYTES + size
        self.budget = self.budget - RECORD_HEAD_BYTES - size if self.samples else 0  # `begun` sets it
        self.samples += 1

"""Samples published by other threads, until the event loop collects them: bounded, counted, behind a lock."""

from collections import deque
from collections.abc import Callable
from threading import Lock

from bus.errors import BusError
from bus.wire.layout import RECORD_HEAD_BYTES


class ThreadQueue:
    """The queue between other threads and the event loop.

    `lock`: a thread has it from its check for room to its `put`, so that no other thread takes the same room.
    `count` and `held_bytes` (records with their heads): samples put and not yet handed over. `late`: payloads
    with their stamps, collected while there was no room for them. `on_first` is called, in the thread that
    publishes, with the first sample since the loop has collected: before `put` returns in any thread.
    """

    def __init__(self, limit_bytes: int, on_first: Callable[[], object] = bool) -> None:
        self.count = 0
        self.held_bytes = 0
        self.late: deque[tuple[bytes, int]] = deque()
        self._limit_bytes = limit_bytes
        self._on_first = on_first
        self.lock = Lock()
        self.refusal: BusError | None = None
        """The publisher is being closed: raised, under the lock, for further samples."""
        self._samples: deque[tuple[bytes, int]] = deque()
        self._skipped = 0
        self._is_announced = False

    def put(self, payload: bytes, stamp_ns: int, depth: int) -> bool:
        """Queue a sample, replacing the oldest above `depth`; returns whether to wake the event loop.

        From any thread, which has the `lock`.
        """
        self._samples.append((payload, stamp_ns))
        self._hold(1, len(payload))
        while len(self._samples) > depth or (self.held_bytes > self._limit_bytes and len(self._samples) > 1):
            self._hold(-1, -len(self._samples.popleft()[0]))
            self._skipped += 1
        must_tell, self._is_announced = not self._is_announced, True
        if must_tell:
            self._on_first()
        return must_tell

    def refuse(self, reason: BusError) -> None:
        """Take no more samples: after this, `collect` gets the last ones."""
        with self.lock:
            self.refusal = reason

    def collect(self) -> int:
        """On the event loop: move queued samples to `late`; returns how many older ones were replaced.

        Samples in `late` still count as held.
        """
        with self.lock:
            self.late += self._samples
            skipped, self._samples, self._skipped = self._skipped, deque(), 0
            self._is_announced = False
            return skipped

    def hand_on(self, take: Callable[[bytes, int], bool]) -> None:
        """On the event loop: pass `late` samples to `take`, the oldest first, until that returns False (no
        room).

        Taken samples are no longer held here: they are counted elsewhere.
        """
        late = self.late
        while late and take(*late[0]):
            with self.lock:
                self._hold(-1, -len(late.popleft()[0]))

    def drop(self) -> int:
        """On the event loop, at the end: drop all samples; returns their number, with the replaced ones."""
        lost = self.collect()
        with self.lock:
            while self.late:
                self._hold(-1, -len(self.late.popleft()[0]))
                lost += 1
        return lost

    def _hold(self, count: int, size: int) -> None:
        self.count += count
        self.held_bytes += size + count * RECORD_HEAD_BYTES

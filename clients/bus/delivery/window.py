"""The credit window of a lossless publisher by socket: how much may leave before subscriptions take more.

busd says how large the window is when it learns of the publisher, and by `Credit` up to which number every
lossless subscription has taken the samples. Counts what was handed over and not yet taken, the run that is
still open, and what other threads have published. Knows no broker, no subscription and no queue.
"""

from collections import deque

from bus.delivery.open_run import OpenRun
from bus.delivery.thread_queue import ThreadQueue
from bus.wire.layout import RECORD_HEAD_BYTES


class CreditWindow:
    """Of the publisher that fills `run`. Closed until `resize`: it has room for a single sample only.

    window.resize(samples=100, size=1 << 20)
    window.hand_over(3, 4000)  # samples up to number 3, with 4,000 bytes of records
    window.credit(3)  # every subscription has taken them
    """

    __slots__ = (
        "_credited_seq",
        "_flying",
        "_flying_bytes",
        "_most_bytes",
        "_most_samples",
        "_run",
        "_threads",
        "last_seq",
    )

    def __init__(self, run: OpenRun, threads: ThreadQueue) -> None:
        self._run = run
        self._threads = threads
        self._most_samples = 0
        self._most_bytes = 0
        self._credited_seq = 0
        self._flying: deque[tuple[int, int]] = deque()  # runs: the number of the last sample, and bytes
        self._flying_bytes = 0
        self.last_seq = 0
        """The highest number given to a sample."""

    def resize(self, samples: int, size: int) -> None:
        """A broker allows so many samples, with `size` bytes of records."""
        self._most_samples, self._most_bytes = samples, size

    def hand_over(self, last_seq: int, size: int) -> None:
        """A run with `size` bytes of records, which ends with number `last_seq`, is on its way."""
        self.last_seq = last_seq
        self._flying.append((last_seq, size))
        self._flying_bytes += size

    def credit(self, seq: int) -> None:
        """All subscriptions have taken everything up to `seq`."""
        self._credited_seq = max(self._credited_seq, seq)
        flying = self._flying
        while flying and flying[0][0] <= seq:
            self._flying_bytes -= flying.popleft()[1]

    def can_take(self, size: int) -> bool:
        """Whether there is room for a sample of `size` bytes; from any thread.

        There always is for one that would be the only one, whatever its size.
        """
        run = self._run
        if run.budget >= size + RECORD_HEAD_BYTES and run.samples < run.most:
            return True
        if not (self._flying or run.samples or self._threads.count):
            return True
        return self._room >= size + RECORD_HEAD_BYTES

    def bound(self, budget: int) -> int:
        """Let the run that was begun go on for as many samples as there is room for.

        Returns how many bytes it may have in all, if without the window it may have `budget`.
        """
        run = self._run
        run.most = run.samples + max(0, self._samples_left)
        return min(budget, self._room)

    @property
    def _room(self) -> int:
        """In bytes."""
        if self._samples_left <= 0:
            return 0
        open_bytes = self._run.size - self._run.samples * RECORD_HEAD_BYTES
        return self._most_bytes - self._flying_bytes - open_bytes - self._threads.held_bytes

    @property
    def _samples_left(self) -> int:
        taken = self.last_seq + self._run.samples + self._threads.count
        return self._most_samples - (taken - self._credited_seq)

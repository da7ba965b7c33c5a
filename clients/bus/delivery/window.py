"""The credit window of a lossless publisher by socket: the samples that may leave before subscriptions take
more.

busd sets the size of the window in its answer to the declaration. `Credit` reports the number up to which
every lossless subscription has taken the samples. The window counts samples handed over and not yet taken,
the open run, and samples of other threads. It knows no broker, no subscription and no queue.
"""

from collections import deque

from bus.delivery.open_run import OpenRun
from bus.delivery.thread_queue import ThreadQueue
from bus.wire.layout import RECORD_HEAD_BYTES


class CreditWindow:
    """The window of the publisher that fills `run`. Until `resize`, it has room only for a single sample.

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
        self._flying: deque[tuple[int, int]] = deque()  # runs: number of the last sample, bytes
        self._flying_bytes = 0
        self.last_seq = 0
        """The highest number given to a sample."""

    def resize(self, samples: int, size: int) -> None:
        """Set the broker's limits: a number of samples, and `size` bytes of records."""
        self._most_samples, self._most_bytes = samples, size

    def hand_over(self, last_seq: int, size: int) -> None:
        """Count a run on its way, with `size` bytes of records, which ends with number `last_seq`."""
        self.last_seq = last_seq
        self._flying.append((last_seq, size))
        self._flying_bytes += size

    def credit(self, seq: int) -> None:
        """Note that all subscriptions have taken the samples up to `seq`."""
        self._credited_seq = max(self._credited_seq, seq)
        flying = self._flying
        while flying and flying[0][0] <= seq:
            self._flying_bytes -= flying.popleft()[1]

    def can_take(self, size: int) -> bool:
        """Whether there is room for a sample of `size` bytes. May be called from any thread.

        There is always room for a single sample, whatever its size.
        """
        run, waiting = self._run, self._threads.count
        # The open run has its room already, but samples of threads take room that it does not know.
        if not waiting and run.budget >= size + RECORD_HEAD_BYTES and run.samples < run.most:
            return True
        if not (self._flying or run.samples or waiting):
            return True
        return self._room >= size + RECORD_HEAD_BYTES

    def bound(self, budget: int) -> int:
        """Limit the new run to the number of samples for which there is room.

        Returns the bytes that it may have in all; without the window, it may have `budget`.
        """
        run = self._run
        run.most = run.samples + max(0, self._samples_left)
        return min(budget, self._room)

    @property
    def _room(self) -> int:
        """Free bytes."""
        if self._samples_left <= 0:
            return 0
        open_bytes = self._run.size - self._run.samples * RECORD_HEAD_BYTES
        return self._most_bytes - self._flying_bytes - open_bytes - self._threads.held_bytes

    @property
    def _samples_left(self) -> int:
        taken = self.last_seq + self._run.samples + self._threads.count
        return self._most_samples - (taken - self._credited_seq)

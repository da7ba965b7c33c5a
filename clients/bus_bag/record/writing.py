"""The writing thread: runs jobs one after the other, outside of the event loop."""

import threading
from collections import deque
from collections.abc import Callable

from bus_bag.storage.writer import Job

__all__ = ["WritingThread"]


class WritingThread:
    """Runs jobs in order. `on_progress` is called in the thread after each job.

    After a job has raised an exception (`failure`), no later jobs run.
    """

    def __init__(self, on_progress: Callable[[], object]) -> None:
        self._on_progress = on_progress
        self._condition = threading.Condition()
        self._jobs: deque[tuple[Job, int]] = deque()
        self._is_ended = False
        self.failure: BaseException | None = None
        self.waiting_bytes = 0
        """Bytes of waiting and running jobs."""
        self._is_busy = False
        self._thread = threading.Thread(target=self._work, name="write the bag", daemon=True)
        self._thread.start()

    def run(self, job: Job, size: int = 0) -> None:
        """Run the job after all earlier ones; not after a failure. `size`: the number of bytes that it
        writes."""
        with self._condition:
            if self.failure is None:
                self._jobs.append((job, size))
                self.waiting_bytes += size
                self._condition.notify()

    @property
    def is_idle(self) -> bool:
        """Whether all jobs have run, or no job will run any more."""
        with self._condition:
            return not self._jobs and not self._is_busy

    def drop(self) -> None:
        """Drop waiting jobs. Jobs of size 0 stay, because later jobs need their topics and files."""
        with self._condition:
            self.waiting_bytes -= sum(size for _, size in self._jobs)
            self._jobs = deque(one for one in self._jobs if not one[1])

    def end(self, timeout_s: float | None = None) -> bool:
        """Wait until all jobs have run, and end the thread; returns False if that takes too long."""
        with self._condition:
            self._is_ended = True
            self._condition.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while True:
            with self._condition:
                while not self._jobs and not self._is_ended:
                    self._condition.wait()
                if not self._jobs:
                    return
                job, size = self._jobs.popleft()
                self._is_busy = True
            try:
                job()
            except Exception as error:
                with self._condition:
                    self.failure = error
                    self._jobs.clear()
                    self.waiting_bytes = 0
            else:
                with self._condition:
                    self.waiting_bytes -= size
            self._is_busy = False
            self._on_progress()

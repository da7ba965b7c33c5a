"""The keeper: a thread in the background that runs the event loop of the facade if no other thread does.

Owns the thread, and the times at which it checks whether to run the loop. Must not know the other ways to run
the loop: they belong to `bus_ros.engine`.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from enum import Enum
from threading import Lock, Thread

_TICK_S = 0.02
"""The keeper runs the loop after a thread has been away from it for this time, or up to twice as long."""


class KeeperState(Enum):
    """The keeper's wait until its next turn."""

    TICKING = "ticking"
    """For a tick."""
    ASLEEP = "asleep"
    """Until it is woken: a thread runs the loop for a long time."""
    CLOSED = "closed"
    """For ever: its thread ends."""


class Keeper:
    """`turn`, called under `guard` at each tick, runs the loop if that is necessary.

    Its argument says whether to run the loop at once. It returns whether the keeper may sleep until `wake`.

    `state` is changed only under the guard. The thread starts with `start`.
    """

    def __init__(self, guard: AbstractContextManager[None], turn: Callable[[bool], bool]) -> None:
        self.state = KeeperState.TICKING
        self._guard = guard
        self._turn = turn
        self._is_urgent = True  # not a state: a signal's handler sets it, without the guard
        self._bell = Lock()
        self._bell.acquire()
        self._thread = Thread(target=self._keep, name="bus keeper", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def nudge(self) -> None:
        """Make the loop run at once; also in a signal's handler."""
        self._is_urgent = True
        self._ring()

    def wake(self) -> None:
        """Under the guard, while it is ASLEEP: no thread runs the loop any more."""
        self.state = KeeperState.TICKING
        self._ring()

    def close(self) -> None:
        """Under the guard: take no more turns."""
        self.state = KeeperState.CLOSED
        self._ring()

    def join(self) -> None:
        """Without the guard: wait until it has closed."""
        self._thread.join()

    def _keep(self) -> None:
        while True:
            with self._guard:
                may_sleep = self.state is not KeeperState.CLOSED and self._take_turn()
                if self.state is KeeperState.CLOSED:  # perhaps while it ran the loop
                    return
                self.state = KeeperState.ASLEEP if may_sleep else KeeperState.TICKING
            self._bell.acquire(True, -1 if may_sleep else _TICK_S)

    def _take_turn(self) -> bool:
        is_urgent, self._is_urgent = self._is_urgent, False
        may_sleep = self._turn(is_urgent)
        self._is_urgent = False  # urgent requests made meanwhile are done
        return may_sleep

    def _ring(self) -> None:
        with suppress(RuntimeError):  # released already: the wake-up is pending
            self._bell.release()

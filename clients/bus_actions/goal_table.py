"""The goals of an action server: their states, the goals that a cancel request means, expiry of results.

Owns: the goals by their ids, and their bounds. Pure: times are given in nanoseconds, nothing waits.
"""

from collections import OrderedDict
from enum import IntEnum
from itertools import islice
from typing import Any, Final, NamedTuple

from bus.errors import LocalProtocolError
from bus_actions.goal_state import GoalEvent, GoalStatus, next_status

__all__ = ["ANY_GOAL", "CancelCode", "Canceled", "Goal", "GoalExists", "GoalTable", "TooManyGoals"]

ANY_GOAL: Final = bytes(16)
"""In a cancel request: no goal in particular."""

MOST_ACTIVE: Final = 1000
"""The most active goals of one server; further goals are refused."""
MOST_ENDED: Final = 1000
"""The most results kept; above it, the oldest is dropped before its time."""
MOST_SHOWN: Final = 20
"""The most ended goals in a status message (the last ones): it is sent at every change."""


class CancelCode(IntEnum):
    """The return_code of action_msgs/srv/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


class Canceled(NamedTuple):
    """The goals that a cancel request means, and the answer if there are none."""

    code: CancelCode
    goals: "tuple[Goal, ...]"


class GoalExists(LocalProtocolError):
    """A goal with that id is known already."""

    def __init__(self) -> None:
        super().__init__("goal ID already exists")


class TooManyGoals(LocalProtocolError):
    """The server has as many active goals as it may."""

    def __init__(self, limit: int) -> None:
        super().__init__(f"{limit} goals are active already")


class Goal:
    """One goal. Only its table changes `status`; `told` is its encoded entry in status messages.

    `told` is None if the entry must be encoded again.
    """

    __slots__ = ("ended_ns", "id", "stamp_ns", "status", "told")

    def __init__(self, goal_id: bytes, stamp_ns: int) -> None:
        self.id = goal_id
        self.stamp_ns = stamp_ns
        self.status = GoalStatus.ACCEPTED
        self.ended_ns = 0
        self.told: Any = None


class GoalTable:
    """The goals of one server. Results are kept for `keep_ns` after a goal's end; below zero: for ever."""

    def __init__(self, keep_ns: int) -> None:
        self._keep_ns = keep_ns
        self._active: dict[bytes, Goal] = {}
        self._ended: OrderedDict[bytes, Goal] = OrderedDict()

    def find(self, goal_id: bytes) -> Goal | None:
        return self._active.get(goal_id) or self._ended.get(goal_id)

    def accept(self, goal_id: bytes, now_ns: int) -> Goal:
        """Raises GoalExists, TooManyGoals."""
        if self.find(goal_id) is not None:
            raise GoalExists
        if len(self._active) >= MOST_ACTIVE:
            raise TooManyGoals(MOST_ACTIVE)
        goal = self._active[goal_id] = Goal(goal_id, now_ns)
        return goal

    def advance(self, goal: Goal, event: GoalEvent, now_ns: int) -> None:
        """Raises InvalidTransition."""
        goal.status = next_status(goal.status, event)
        goal.told = None
        if goal.status.is_end:
            goal.ended_ns = now_ns
            self._ended[goal.id] = self._active.pop(goal.id)

    def canceled_by(self, goal_id: bytes, stamp_ns: int) -> Canceled:
        """The goals that a cancel request with that id and stamp means, by ROS 2's rules.

        A goal's id: that goal. A stamp: all goals accepted until then. Both: the one and the others. Neither:
        all.
        """
        if goal_id != ANY_GOAL and not stamp_ns:
            goal = self.find(goal_id)
            if goal is None:
                return Canceled(CancelCode.UNKNOWN_GOAL_ID, ())
            if not _may_be_canceled(goal):
                return Canceled(CancelCode.GOAL_TERMINATED, ())
            return Canceled(CancelCode.NONE, (goal,))
        is_all = goal_id == ANY_GOAL and not stamp_ns
        meant = (
            goal
            for goal in self._active.values()
            if is_all or goal.id == goal_id or goal.stamp_ns <= stamp_ns
        )
        return Canceled(CancelCode.NONE, tuple(filter(_may_be_canceled, meant)))

    def shown(self) -> list[Goal]:
        """Goals of a status message: the last ended goals, then the active ones."""
        ended = list(islice(reversed(self._ended.values()), MOST_SHOWN))
        return [*reversed(ended), *self._active.values()]

    def expire(self, now_ns: int) -> list[Goal]:
        """Forget the goals with expired results; returns them."""
        gone: list[Goal] = []
        for goal in self._ended.values():
            if len(self._ended) - len(gone) <= MOST_ENDED and not self._is_over(goal, now_ns):
                break
            gone.append(goal)
        for goal in gone:
            del self._ended[goal.id]
        return gone

    def next_expiry_ns(self) -> int | None:
        """When `expire` has something to do again; None if no result is kept, or all are kept for ever."""
        if self._keep_ns < 0 or not self._ended:
            return None
        return next(iter(self._ended.values())).ended_ns + self._keep_ns

    @property
    def is_overfull(self) -> bool:
        """Whether too many results are kept, until `expire`."""
        return len(self._ended) > MOST_ENDED

    def active(self) -> list[Goal]:
        return list(self._active.values())

    def _is_over(self, goal: Goal, now_ns: int) -> bool:
        return 0 <= self._keep_ns <= now_ns - goal.ended_ns


def _may_be_canceled(goal: Goal) -> bool:
    return goal.status in (GoalStatus.ACCEPTED, GoalStatus.EXECUTING)

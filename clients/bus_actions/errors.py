"""What can come of a goal other than its result.

BusError
├── ActionUnavailable         nobody serves the action, or its server left before the goal's end
├── GoalRejected              the server does not take the goal
├── GoalAborted               the server gave the goal up; result
└── GoalCanceled              the goal was canceled; result
"""

from typing import Any

from bus.errors import BusError

__all__ = ["ActionUnavailable", "GoalAborted", "GoalCanceled", "GoalRejected"]


class ActionUnavailable(BusError):
    """Nobody serves the action, or its server has left before the goal had ended."""

    def __init__(self, action: str, why: str) -> None:
        super().__init__(f"action '{action}' is not available: {why}")
        self.action = action
        """The action's full name."""


class GoalRejected(BusError):
    """The server does not take the goal."""

    def __init__(self, action: str) -> None:
        super().__init__(f"action '{action}' rejected the goal")
        self.action = action
        """The action's full name."""


class GoalAborted(BusError):
    """The server gave the goal up: its `execute` said so, or raised."""

    def __init__(self, action: str, result: Any) -> None:
        super().__init__(f"action '{action}' aborted the goal")
        self.action = action
        """The action's full name."""
        self.result = result
        """What the server gave nevertheless; a Result without content where it gave nothing."""


class GoalCanceled(BusError):
    """The goal was canceled before it was done."""

    def __init__(self, action: str, result: Any) -> None:
        super().__init__(f"action '{action}': the goal was canceled")
        self.action = action
        """The action's full name."""
        self.result = result
        """What had been done until then; a Result without content where the server gave nothing."""

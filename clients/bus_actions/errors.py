"""Errors of a goal that ends without success.

BusError
├── ActionUnavailable         no server of the action exists, or it left before the goal's end
├── GoalRejected              the server does not accept the goal
├── GoalAborted               the server aborted the goal; result
└── GoalCanceled              the goal was canceled; result
"""

from typing import Any

from bus.errors import BusError

__all__ = ["ActionUnavailable", "GoalAborted", "GoalCanceled", "GoalRejected"]


class ActionUnavailable(BusError):
    """No server of the action exists, or its server left before the goal's end."""

    def __init__(self, action: str, why: str) -> None:
        super().__init__(f"action '{action}' is not available: {why}")
        self.action = action
        """The action's full name."""


class GoalRejected(BusError):
    """The server does not accept the goal."""

    def __init__(self, action: str) -> None:
        super().__init__(f"action '{action}' rejected the goal")
        self.action = action
        """The action's full name."""


class GoalAborted(BusError):
    """The server aborted the goal: its `execute` did so, or raised an exception."""

    def __init__(self, action: str, result: Any) -> None:
        super().__init__(f"action '{action}' aborted the goal")
        self.action = action
        """The action's full name."""
        self.result = result
        """The server's Result in spite of that; an empty Result if it set none."""


class GoalCanceled(BusError):
    """The goal was canceled before it was done."""

    def __init__(self, action: str, result: Any) -> None:
        super().__init__(f"action '{action}': the goal was canceled")
        self.action = action
        """The action's full name."""
        self.result = result
        """The result until then; an empty Result if the server set none."""

"""The names of rclpy.action.server; making any of the classes says that actions are missing."""

from enum import Enum, IntEnum
from typing import Any

__all__ = [
    "ActionServer",
    "CancelResponse",
    "GoalEvent",
    "GoalResponse",
    "ServerGoalHandle",
    "default_cancel_callback",
    "default_goal_callback",
    "default_handle_accepted_callback",
]


class GoalResponse(Enum):
    """A goal callback's answer."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """A cancel callback's answer."""

    REJECT = 1
    ACCEPT = 2


class GoalEvent(IntEnum):
    """Events that move a goal from one state to the next."""

    EXECUTE = 1
    CANCEL_GOAL = 2
    SUCCEED = 3
    ABORT = 4
    CANCELED = 5


def default_goal_callback(goal_request: object) -> GoalResponse:
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: object) -> CancelResponse:
    """Reject every cancellation."""
    return CancelResponse.REJECT


def default_handle_accepted_callback(goal_handle: Any) -> None:
    """Execute it at once."""
    goal_handle.execute()


class ActionServer:
    """Would execute the goals of action clients."""

    def __init__(
        self,
        node: object = None,
        action_type: object = None,
        action_name: str = "",
        execute_callback: object = None,
        **_: object,
    ) -> None:
        raise NotImplementedError(
            f"busd has no actions yet, so there is no ActionServer '{action_name}': "
            "use a service (create_service) for the goal and a topic (create_publisher) for the feedback"
        )


class ServerGoalHandle:
    """Would stand for a goal that came."""

    def __init__(self, *_: object, **__: object) -> None:
        raise NotImplementedError("busd has no actions yet, so there are no goals")

"""The names of rclpy.action.client; making any of them says that actions are missing."""

from typing import Any

__all__ = ["ActionClient", "ClientGoalHandle", "GoalStatus"]  # noqa: F822 - made by __getattr__


class ActionClient:
    """Would send goals to an action server."""

    def __init__(
        self, node: object = None, action_type: object = None, action_name: str = "", **_: object
    ) -> None:
        raise NotImplementedError(
            f"busd has no actions yet, so there is no ActionClient for '{action_name}': "
            "use a service (create_client) for the goal and a topic (create_subscription) for the feedback"
        )


class ClientGoalHandle:
    """Would stand for a goal that was sent."""

    def __init__(self, *_: object, **__: object) -> None:
        raise NotImplementedError("busd has no actions yet, so there are no goals")


def __getattr__(name: str) -> Any:
    if name == "GoalStatus":  # a message class, and made as late as all of them
        from bus_ros.rosidl import message_class

        return message_class("action_msgs/msg/GoalStatus")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

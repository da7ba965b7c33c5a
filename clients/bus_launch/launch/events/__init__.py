"""Events of a launch; programs import them as `launch.events`. Those of processes are in `process`.

Events are values: they say what happened, and handlers decide what follows. Classes, names and arguments are
ROS 2's.

Read first: `process.py`. Tests: `tests/unit/bus_launch/launch/test_event_handlers.py`,
`tests/system/test_launch_processes.py`.
"""

from collections.abc import Callable
from typing import Any

from bus_launch.launch.core import Event, LaunchDescriptionEntity

__all__ = [
    "ExecutionComplete",
    "IncludeLaunchDescription",
    "Shutdown",
    "TimerEvent",
    "matches_action",
]


class ExecutionComplete(Event):
    """An action has done its work."""

    name = "launch.events.ExecutionComplete"

    def __init__(self, *, action: LaunchDescriptionEntity) -> None:
        self.__action = action

    @property
    def action(self) -> LaunchDescriptionEntity:
        return self.__action


class IncludeLaunchDescription(Event):
    """A request to visit a launch description."""

    name = "launch.events.IncludeLaunchDescription"

    def __init__(self, launch_description: LaunchDescriptionEntity) -> None:
        self.__launch_description = launch_description

    @property
    def launch_description(self) -> LaunchDescriptionEntity:
        return self.__launch_description


class Shutdown(Event):
    """The launch ends; `due_to_sigint` if a terminal's Ctrl-C is the reason."""

    name = "launch.events.Shutdown"

    def __init__(self, *, reason: str = "reason not given", due_to_sigint: bool = False) -> None:
        self.__reason = reason
        self.__due_to_sigint = due_to_sigint

    @property
    def reason(self) -> str:
        return self.__reason

    @property
    def due_to_sigint(self) -> bool:
        return self.__due_to_sigint


class TimerEvent(Event):
    """The time of a timer has come."""

    name = "launch.events.TimerEvent"

    def __init__(self, *, timer_action: LaunchDescriptionEntity) -> None:
        self.__timer_action = timer_action

    @property
    def timer_action(self) -> LaunchDescriptionEntity:
        return self.__timer_action


def matches_action(target_action: LaunchDescriptionEntity) -> Callable[[Any], bool]:
    """Whether an action is that one; for events that look for their process."""
    return lambda action: action is target_action

"""Events of lifecycle nodes; programs import it as `launch_ros.events.lifecycle`."""

from collections.abc import Callable
from typing import Any

from bus_launch.launch.core import Event, LaunchDescriptionEntity
from bus_launch.launch_ros.events.matchers import matches_node_name

__all__ = ["ChangeState", "StateTransition", "matches_node_name"]


class ChangeState(Event):
    """A request for a transition to the nodes that the matcher accepts."""

    name = "launch_ros.events.lifecycle.ChangeState"

    def __init__(self, *, lifecycle_node_matcher: Callable[[Any], bool], transition_id: int) -> None:
        self.__matcher = lifecycle_node_matcher
        self.__transition_id = transition_id

    @property
    def lifecycle_node_matcher(self) -> Callable[[Any], bool]:
        return self.__matcher

    @property
    def transition_id(self) -> int:
        return self.__transition_id


class StateTransition(Event):
    """A node has made a transition; `msg` is its lifecycle_msgs/msg/TransitionEvent."""

    name = "launch_ros.events.lifecycle.StateTransition"

    def __init__(self, *, action: LaunchDescriptionEntity, msg: Any) -> None:
        self.__action = action
        self.__msg = msg

    @property
    def action(self) -> LaunchDescriptionEntity:
        return self.__action

    @property
    def msg(self) -> Any:
        return self.__msg

    @property
    def transition(self) -> str:
        return str(self.__msg.transition.label)

    @property
    def start_state(self) -> str:
        return str(self.__msg.start_state.label)

    @property
    def goal_state(self) -> str:
        return str(self.__msg.goal_state.label)

"""The five services for other programs to see and change a lifecycle node's state, and its event topic.

Owns: conversion of requests for the state machine, and of its results to messages. Must not know: callbacks,
or the work of a transition. A wrong request from another program gets an answer, never an error here.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from bus.errors import ConnectionClosed
from bus_ros.engine import engine
from bus_ros.rclpy.exceptions import InvalidHandle, RCLError
from bus_ros.rclpy.impl.base_node import base_of
from bus_ros.rclpy.impl.transition_callback_return import TransitionCallbackReturnType
from bus_ros.rclpy.lifecycle.state_machine import (
    STATES,
    Description,
    LifecycleStateMachine,
    Transition,
)
from bus_ros.rclpy.qos import profile_of, to_native
from bus_ros.rosidl import message_class, service_class

__all__ = ["LifecycleServices"]

EVENTS_DEPTH = 10


class LifecycleServices:
    """The services of `node`; `change_state` makes the transitions. Served from `begin` on.

    `is_async`: it is an AsyncNode, and `change_state` is a coroutine function.
    """

    def __init__(
        self, node: Any, change_state: Callable[[int], Any], callback_group: Any, *, is_async: bool
    ) -> None:
        self._node = node
        self._base = base_of(node)
        self._is_async = is_async
        self._change_state = change_state
        self._callback_group = callback_group
        self._state: Any = message_class("lifecycle_msgs/msg/State")
        self._event: Any = message_class("lifecycle_msgs/msg/TransitionEvent")
        self._description: Any = message_class("lifecycle_msgs/msg/TransitionDescription")
        self._publish: Callable[[Any], object] = self._make_publisher(self._name("transition_event"))

    def begin(self, machine: LifecycleStateMachine) -> None:
        """Begin to serve the state of `machine`."""
        self._machine = machine
        for srv_type, name, callback in (
            ("ChangeState", "change_state", self._change_async if self._is_async else self._change),
            ("GetState", "get_state", self._get_state),
            ("GetAvailableStates", "get_available_states", self._get_states),
            ("GetAvailableTransitions", "get_available_transitions", self._get_transitions),
            ("GetAvailableTransitions", "get_transition_graph", self._get_graph),
        ):
            definition = service_class(f"lifecycle_msgs/srv/{srv_type}")
            served = self._base.create_service(
                self._node, definition, self._name(name), callback, callback_group=self._callback_group
            )
            setattr(self._node, f"_service_{name}", served)

    def publish_transition(self, transition: Transition) -> None:
        """Publish that the node has made it; a destroyed node makes transitions without this event."""
        event = self._event(timestamp=self._node.get_clock().now().nanoseconds)
        event.transition.id, event.transition.label = transition.id, transition.label
        event.start_state = self._state(id=transition.start, label=STATES[transition.start])
        event.goal_state = self._state(id=transition.goal, label=STATES[transition.goal])
        with suppress(ConnectionClosed, InvalidHandle):
            self._publish(event)

    def _make_publisher(self, topic: str) -> Callable[[Any], object]:
        if self._is_async:
            publisher = self._base.create_publisher(self._node, self._event, topic, EVENTS_DEPTH)
            return publisher.publish  # type: ignore[no-any-return]
        # Not one of the node's publishers, as in rclpy: it is not listed, and no program destroys it.
        native = self._node.native
        qos = to_native(profile_of(EVENTS_DEPTH), for_publisher=True)
        made: Any = engine().run(lambda: native.create_publisher(self._event, topic, qos))
        return lambda event: engine().call(made.publish, event)

    def _name(self, name: str) -> str:
        return f"{self._node.get_fully_qualified_name()}/{name}"

    def _change(self, request: Any, response: Any) -> Any:
        with suppress(RCLError):  # the log has it; a wrong id ends ROS 2's node
            result = self._change_state(self._number(request.transition))
            response.success = result is TransitionCallbackReturnType.SUCCESS
        return response

    async def _change_async(self, request: Any, response: Any) -> Any:
        with suppress(RCLError):
            result = await self._change_state(self._number(request.transition))
            response.success = result is TransitionCallbackReturnType.SUCCESS
        return response

    def _number(self, wanted: Any) -> int:
        """The id of a requested transition. As in ROS 2, a label comes before an id. Raises RCLError."""
        return self._machine.get_transition_by_label(wanted.label) if wanted.label else wanted.id

    def _get_state(self, request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = self._machine.current_state
        return response

    def _get_states(self, request: Any, response: Any) -> Any:
        response.available_states = [
            self._state(id=number, label=label) for number, label in self._machine.available_states
        ]
        return response

    def _get_transitions(self, request: Any, response: Any) -> Any:
        return self._fill(response, self._machine.available_transitions)

    def _get_graph(self, request: Any, response: Any) -> Any:
        return self._fill(response, self._machine.transition_graph)

    def _fill(self, response: Any, descriptions: Iterable[Description]) -> Any:
        for number, label, start, start_label, goal, goal_label in descriptions:
            one = self._description()
            one.transition.id, one.transition.label = number, label
            one.start_state.id, one.start_state.label = start, start_label
            one.goal_state.id, one.goal_state.label = goal, goal_label
            response.available_transitions.append(one)
        return response

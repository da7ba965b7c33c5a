"""Lifecycle nodes: nodes that other programs configure, activate, deactivate, clean up and shut down.

Owns: the callbacks, the managed entities, and the effect of a callback's result on the state machine.
`services` has requests from outside, `state_machine` the states.
"""

from collections.abc import Callable, Generator
from typing import Any, TypeVar, cast

from bus.base.callbacks import is_async
from bus_ros.rclpy.callback_groups import CallbackGroup
from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.impl.base_node import base_of
from bus_ros.rclpy.lifecycle.managed_entity import LifecycleState, ManagedEntity, TransitionCallbackReturn
from bus_ros.rclpy.lifecycle.publisher import LifecyclePublisher
from bus_ros.rclpy.lifecycle.services import LifecycleServices
from bus_ros.rclpy.lifecycle.state_machine import TRANSITIONS, LifecycleStateMachine
from bus_ros.rclpy.logging import get_logger
from bus_ros.rclpy.node import Node

__all__ = [
    "LifecycleNode",
    "LifecycleNodeMixin",
    "LifecyclePublisher",
    "LifecycleState",
    "ManagedEntity",
    "TransitionCallbackReturn",
]

M = TypeVar("M")

_Callback = Callable[[LifecycleState], TransitionCallbackReturn]
TransitionSteps = Generator[Any, Any, TransitionCallbackReturn]

_CALLBACKS = {
    10: "on_configure",
    11: "on_cleanup",
    12: "on_shutdown",
    13: "on_activate",
    14: "on_deactivate",
    15: "on_error",
}
"""For each state between two others: the callback that decides on the next state."""


class LifecycleNodeMixin(ManagedEntity):
    """A lifecycle node's additions to a node. A class that inherits both calls `Node.__init__` first.

    Without `enable_communication_interface`, other programs can neither request transitions nor see them.
    `callback_group` is the group of its services.
    """

    _lifecycle_publisher_class: type[Any] = LifecyclePublisher

    def __init__(
        self, *, enable_communication_interface: bool = True, callback_group: CallbackGroup | None = None
    ) -> None:
        node: Any = self
        self._callbacks: dict[int, _Callback] = {}
        for state_id, name in _CALLBACKS.items():
            self.__register_callback(state_id, getattr(self, name))
        self._managed_entities: dict[ManagedEntity, None] = {}  # in the order of their calls
        warn = get_logger("rcl_lifecycle").warning
        if not enable_communication_interface:
            self._state_machine = LifecycleStateMachine(lambda _: None, warn)
            return
        services = LifecycleServices(
            node, self.__change_state, callback_group, is_async=is_async(self._run_transition)
        )
        self._state_machine = LifecycleStateMachine(services.publish_transition, warn)
        services.begin(self._state_machine)

    # --- transitions that the program itself requests

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Call `on_configure` and go to the state for its result; returns it. So do the other triggers.

        In an AsyncLifecycleNode they are awaited. Raises RCLError if the transition is not possible now,
        TypeError if the callback returns no TransitionCallbackReturn.
        """
        return self.__trigger("configure")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        return self.__trigger("cleanup")

    def trigger_activate(self) -> TransitionCallbackReturn:
        return self.__trigger("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        return self.__trigger("deactivate")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        state, _ = self._state_machine.current_state
        for one in TRANSITIONS:
            if one.label == "shutdown" and one.start == state:
                return self.__change_state(one.id)
        raise RCLError("Shutdown transtion not possible")

    # --- managed entities

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Let this node's callbacks call the entity's at each transition; overridden callbacks do not."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities[entity] = None

    def create_lifecycle_publisher(
        self, msg_type: type[M], topic: str, *args: Any, **keywords: Any
    ) -> LifecyclePublisher[M]:
        """As `create_publisher`; it publishes only while the node is active."""
        if "publisher_class" in keywords:
            raise TypeError("create_publisher() got an unexpected keyword argument 'publisher_class'")
        node: Any = self
        publisher: Any = base_of(node).create_publisher(
            node, msg_type, topic, *args, **keywords, publisher_class=self._lifecycle_publisher_class
        )
        self._managed_entities[publisher] = None
        return cast(LifecyclePublisher[M], publisher)

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher[Any]) -> bool:
        """Destroy a publisher; returns whether it belonged to this node."""
        self._managed_entities.pop(publisher, None)
        node: Any = self
        return bool(base_of(node).destroy_publisher(node, publisher))

    # --- callbacks; a program's own node overrides some of them

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Call the managed entities; returns the first result that is not SUCCESS. So do the other callbacks.

        `state` is the node's previous state.
        """
        return self.__tell_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.__tell_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.__tell_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.__tell_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self.__tell_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called after a callback that returned ERROR or raised.

        On SUCCESS the node is unconfigured, otherwise finalized.
        """
        return self.__tell_entities("on_error", state)

    # --- inside

    def __register_callback(self, state_id: int, callback: _Callback) -> bool:
        self._callbacks[state_id] = callback
        return True

    def __tell_entities(self, callback: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in tuple(self._managed_entities):
            result = getattr(entity, callback)(state)
            if not isinstance(result, TransitionCallbackReturn):
                raise TypeError(
                    f"{callback}() return value of class {type(entity)} should be `TransitionCallbackReturn`."
                    f"\nInstance of the class that caused the failure: {entity}"
                )
            if result is not TransitionCallbackReturn.SUCCESS:
                return result
        return TransitionCallbackReturn.SUCCESS

    def __trigger(self, label: str) -> TransitionCallbackReturn:
        return self.__change_state(next(one.id for one in TRANSITIONS if one.label == label))

    def __change_state(self, transition_id: int) -> TransitionCallbackReturn:
        result: TransitionCallbackReturn = self._run_transition(self.__transition(transition_id))
        return result

    def _run_transition(self, steps: "TransitionSteps") -> Any:
        """Run a transition. It yields the result of each callback, and gets that result sent.

        An AsyncNode awaits it in between.
        """
        try:
            result = next(steps)
            while True:
                result = steps.send(result)
        except StopIteration as end:
            return end.value

    def __transition(self, transition_id: int) -> "TransitionSteps":
        machine = self._state_machine
        state_id, label = machine.current_state
        before = LifecycleState(label=label, state_id=state_id)
        machine.begin_transition_by_id(transition_id)
        result = yield from self.__call_back(before)
        machine.trigger_transition_by_label(result.to_label())
        if result is TransitionCallbackReturn.ERROR:
            result_of_error = yield from self.__call_back(before)
            machine.trigger_transition_by_label(result_of_error.to_label())
        return result

    def __call_back(self, before: LifecycleState) -> "TransitionSteps":
        """Call the callback of the current state. Raises TypeError for a wrong type of its result."""
        node: Any = self
        callback = self._callbacks[self._state_machine.current_state[0]]
        name = getattr(callback, "__name__", repr(callback))
        try:
            result = yield callback(before)
        except Exception as error:
            from traceback import format_exception

            trace = error.__traceback__ and error.__traceback__.tb_next  # without this method
            text = "".join(format_exception(type(error), error, trace)).rstrip()
            node.get_logger().error(f"{name}() raised, which counts as ERROR:\n{text}")
            return TransitionCallbackReturn.ERROR
        if not isinstance(result, TransitionCallbackReturn):
            raise TypeError(
                f"{name}() of node '{node.get_fully_qualified_name()}' must return a"
                f" TransitionCallbackReturn, not {type(result).__name__}"
            )
        return result


class LifecycleNode(LifecycleNodeMixin, Node):
    """A node that other programs configure, activate and shut down; it takes the arguments of Node, too.

    Raises as Node does, and TypeError for an `enable_communication_interface` that is no bool.
    """

    def __init__(
        self, node_name: str, *, enable_communication_interface: bool = True, **keywords: Any
    ) -> None:
        if not isinstance(enable_communication_interface, int | None):
            raise TypeError(
                f"enable_communication_interface must be a bool, not {enable_communication_interface!r}"
            )
        Node.__init__(self, node_name, **keywords)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)

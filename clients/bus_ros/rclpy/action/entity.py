"""The common base of action servers and clients: a queue of calls for an executor, and checks of names.

Owns: the queue. Must not know: goals, messages.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, Final

from bus.errors import ConfigurationError
from bus.names import validate_topic_name
from bus.qos import QoSProfile as NativeProfile
from bus_actions.endpoints import ActionQoS
from bus_ros.engine import Engine, engine
from bus_ros.entity import Entity, Work
from bus_ros.rclpy.callback_groups import CallbackGroup
from bus_ros.rclpy.impl.executor_parts import await_or_execute
from bus_ros.rclpy.impl.native_node import service_qos as native_service_qos
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile, profile_of, to_native
from bus_ros.rclpy.type_support import check_for_type_support
from bus_ros.rclpy.waitable import Waitable

__all__ = ["FEEDBACK_QOS", "ActionEntity", "action_qos", "check_action_name", "check_action_type"]

FEEDBACK_QOS: Final = QoSProfile(depth=10)
"""The default QoS of feedback."""


class ActionEntity(Entity, Waitable):
    """Base of ActionServer and ActionClient: one entity, in one callback group, as in rclpy.

    An executor takes its calls; a program with its own wait set may take them instead.
    """

    is_async = True

    def __init__(self, node: Node, callback_group: CallbackGroup | None) -> None:
        self._engine: Engine = engine()
        self._calls: deque[Work] = deque()
        self._node = node
        super().__init__(node, callback_group or node.default_callback_group)
        self._logger = node.get_logger()
        self.is_queued = True  # until it is open: no executor takes earlier calls
        self._futures: list[Any] = []
        self._source: Any = None  # for wait sets
        self._index: int | None = None

    def destroy(self) -> None:
        raise NotImplementedError

    def take(self, most: int) -> Work | None:
        return self._calls.popleft() if self._calls else None

    def _put(self, function: Callable[..., object], *arguments: Any) -> None:
        """Under the guard: queue a call for an executor."""
        self._calls.append((function, arguments))
        self.notify()

    # --- as a waitable

    def add_to_wait_set(self, wait_set: Any) -> None:
        if self._source is None:
            from bus_ros.rclpy.impl.wait_set import Calls  # late: few programs have wait sets

            self._source = Calls(self)
            with self._engine.loop:
                self.notify = self._notify_both  # type: ignore[method-assign]
                self._begin_to_hear()
        self._index = wait_set.add_action(self._source)

    def is_ready(self, wait_set: Any) -> bool:
        return self._index is not None and bool(wait_set.is_ready("action", self._index))

    def take_data(self) -> Work | None:
        """The next call, for `execute`."""
        found: Work | None = self._source.take_call()
        return found

    async def execute(self, taken_data: Work | None) -> None:
        """Make the call."""
        if taken_data is not None:
            function, arguments = taken_data
            await await_or_execute(function, *arguments)

    def _notify_both(self) -> None:
        Entity.notify(self)
        self._source.come()

    def _begin_to_hear(self) -> None:
        """Let `notify` announce arrivals that do not make a call themselves."""

    def __enter__(self) -> "ActionEntity":
        return self

    def __exit__(self, *_: object) -> None:
        """Destroys nothing, as in rclpy."""


def check_action_type(action_type: Any) -> None:
    """Raises AttributeError, as rclpy does, if it is not a ROS type; RuntimeError if it is no action."""
    check_for_type_support(action_type)
    if not hasattr(action_type, "Goal"):
        raise RuntimeError(
            f"The action type provided is not valid ({action_type}), this might be a message or service"
        )


def check_action_name(name: str, *, is_server: bool) -> None:
    """Raises ValueError for an invalid name, in rclpy's words."""
    try:
        validate_topic_name(name)
    except ConfigurationError as error:
        rule = str(error).partition(": ")[2].partition(":\n")[0]
        if is_server:
            rule = f": {rule if name else 'invalid empty action name'}"
        elif not name:
            raise ValueError("Failed to create action client: failed to get goal service name") from None
        what = "server" if is_server else "client"
        raise ValueError(
            f"Failed to create action {what} due to invalid topic name '{name}' : {rule}"
        ) from None


def action_qos(
    goal: QoSProfile | int,
    result: QoSProfile | int,
    cancel: QoSProfile | int,
    feedback: QoSProfile | int,
    status: QoSProfile | int,
    *,
    is_server: bool,
) -> ActionQoS:
    """The policies as native ones."""

    def topic(profile: QoSProfile | int) -> NativeProfile:
        return to_native(profile_of(profile), for_publisher=is_server)

    return ActionQoS(
        goal_service=native_service_qos(profile_of(goal)),
        result_service=native_service_qos(profile_of(result)),
        cancel_service=native_service_qos(profile_of(cancel)),
        feedback=topic(feedback),
        status=topic(status),
    )

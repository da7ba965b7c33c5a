"""Types of actions, and the messages that carry their parts over the bus.

Owns: the base class of an action's definition, and the classes sent over the bus for it. A goal, a result or
feedback is sent within a ROS 2 message that also has the goal's id: `<pkg>/action/<Name>_SendGoal_Request`
and so on. Must not know: topics.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any, ClassVar, Final

from msgspec import Raw, defstruct, field, msgpack

from bus.errors import ConfigurationError, MessageTypeError
from bus.msg import Message, int8
from bus.srv import make_service
from bus.types.classes import message_class, service_class
from bus.types.idl import CARRIERS, PARTS
from bus_actions.goal_table import Goal

__all__ = ["Action", "ActionSupport", "action_support", "find_action", "make_action"]

_NS: Final = 1_000_000_000
_encode: Final = msgpack.Encoder().encode
_PLAIN: Final[dict[str, tuple[Any, Any]]] = {"bool": (bool, False), "int8": (int8, 0)}


class Action:
    """Base of an action's definition: three message classes, `Goal`, `Result` and `Feedback`, within it.

    `__type_name__` is `local/action/<Class>`, or the name that the class itself sets. It is never
    instantiated: see `ActionServer` and `ActionClient`.

        class Count(Action):
            class Goal(Message, kw_only=True):
                target: int32 = 0

            class Result(Message, kw_only=True):
                reached: int32 = 0

            class Feedback(Message, kw_only=True):
                current: int32 = 0
    """

    __type_name__: ClassVar[str]
    Goal: ClassVar[type[Any]]
    """The message class of goals."""
    Result: ClassVar[type[Any]]
    """The message class of results; made without arguments if a goal ends without a result."""
    Feedback: ClassVar[type[Any]]
    """The message class of feedback."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__type_name__" not in cls.__dict__:
            cls.__type_name__ = f"local/action/{cls.__name__}"
        for part in PARTS["action"]:
            message = cls.__dict__.get(part)
            if message is not None and message.__qualname__ == f"{cls.__qualname__}.{part}":
                message.__type_name__ = f"{cls.__type_name__}_{part}"
                message.__name__ = f"{cls.__name__}_{part}"  # as ROS 2 calls it in its texts


def find_action(name: str) -> Any:
    """The action called `name` (`example_interfaces/action/Fibonacci`), made of its definition.

    Searches definitions in the workspace, in AMENT_PREFIX_PATH and in BUS_INTERFACE_PATH; some come with busd
    (`bus interface list`). Raises ConfigurationError if the definition is missing or malformed.

        Fibonacci = find_action("example_interfaces/action/Fibonacci")
    """
    parts = {part: message_class(f"{name}_{part}") for part in PARTS["action"]}
    return make_action(name, parts["Goal"], parts["Result"], parts["Feedback"])


@cache
def make_action(name: str, goal: type[Any], result: type[Any], feedback: type[Any]) -> type[Action]:
    """The action called `name` (`demo/action/Count`) with these three message classes."""
    contents = {"__type_name__": name, "Goal": goal, "Result": result, "Feedback": feedback}
    return type(name.rpartition("/")[2], (Action,), contents)


class ActionSupport:
    """The classes that carry one action; get it from `action_support(action_type)`.

    Raises MessageTypeError if the class does not define an action, ConfigurationError for a bad type name.
    """

    def __init__(self, action_type: Any) -> None:
        try:
            self.goal: Any = action_type.Goal
            self.result: Any = action_type.Result
            self.feedback: Any = action_type.Feedback
        except AttributeError:
            raise MessageTypeError(
                f"{action_type!r:.80} is no action: it has no message classes Goal, Result and Feedback"
            ) from None
        self.name: str = getattr(action_type, "__type_name__", "")
        if self.name.count("/action/") != 1 or self.name.count("/") != 2:
            raise ConfigurationError(
                f"__type_name__ of {action_type!r:.80} must have three parts, like "
                f"'example_interfaces/action/Fibonacci'; it is {self.name!r}"
            )
        # The same for every action: no program sees them, and messages of rosidl's classes would take ten
        # times as long.
        self.status_array: Any = message_class("action_msgs/msg/GoalStatusArray")
        self.status: Any = message_class("action_msgs/msg/GoalStatus")
        if hasattr(action_type, "Impl"):  # made by rosidl, or as rosidl does it
            ready = action_type.Impl
            self.send_goal: Any = ready.SendGoalService
            self.get_result: Any = ready.GetResultService
            self.feedback_message: Any = ready.FeedbackMessage
            self.cancel_goal: Any = ready.CancelGoalService
            self.goal_info: Any = self.cancel_goal.Request.__nested__["goal_info"]
            self.uuid: Any = self.goal_info.__nested__["goal_id"]
            self._id_of: Any = list
            return
        parts = {"Goal": self.goal, "Result": self.result, "Feedback": self.feedback}
        made = {part: _carrier(self.name, part, parts) for part in CARRIERS}
        self.send_goal = make_service(
            f"{self.name}_SendGoal", made["SendGoal_Request"], made["SendGoal_Response"]
        )
        self.get_result = make_service(
            f"{self.name}_GetResult", made["GetResult_Request"], made["GetResult_Response"]
        )
        self.feedback_message = made["FeedbackMessage"]
        self.cancel_goal = service_class("action_msgs/srv/CancelGoal")
        self.goal_info = message_class("action_msgs/msg/GoalInfo")
        self.uuid = message_class("unique_identifier_msgs/msg/UUID")
        self._id_of = bytes

    def goal_id(self, goal_id: bytes) -> Any:
        """A UUID."""
        return self.uuid(uuid=self._id_of(goal_id))

    def info_of(self, goal: Goal) -> Any:
        """A GoalInfo."""
        info = self.goal_info(goal_id=self.goal_id(goal.id))
        info.stamp.sec, info.stamp.nanosec = divmod(goal.stamp_ns, _NS)
        return info

    def encoded_status(self, goals: Iterable[Goal]) -> bytes:
        """A GoalStatusArray. Each change of one goal sends the states of all; the others are encoded
        already.
        """
        for goal in (goals := tuple(goals)):
            if goal.told is None:
                status = self.status(status=int(goal.status))
                info = status.goal_info
                info.goal_id.uuid = goal.id
                info.stamp.sec, info.stamp.nanosec = divmod(goal.stamp_ns, _NS)
                goal.told = Raw(_encode(status))
        return _encode(self.status_array(status_list=[goal.told for goal in goals]))


@cache
def action_support(action_type: Any) -> ActionSupport:
    """The ActionSupport of a class with `Goal`, `Result`, `Feedback` and `__type_name__`, made once."""
    return ActionSupport(action_type)


def _carrier(name: str, part: str, parts: dict[str, type[Any]]) -> type[Any]:
    """A native class that carries a part of an action."""
    fields: list[tuple[str, Any, Any]] = []
    for own, base in CARRIERS[part]:
        if base in _PLAIN:
            fields.append((own, *_PLAIN[base]))
        else:
            cls = parts.get(base) or message_class(base)
            fields.append((own, cls, field(default_factory=cls)))
    package, kind, short = name.split("/")
    return defstruct(
        f"{short}_{part}",
        fields,
        bases=(Message,),
        namespace={"__type_name__": f"{name}_{part}"},
        module=f"{package}.{kind}",
        kw_only=True,
    )

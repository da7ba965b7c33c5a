"""The rosidl-style classes of messages, services and actions, made from their definitions at first use.

Owns: one class for each name, copying and pickling of messages, and the way to its TypeSupport. Must not
know: the wire, import hooks.

    >>> message_class("std_msgs/msg/String")(data="hi")
    std_msgs.msg.String(data='hi')
"""

import os
import re
from collections.abc import Mapping
from threading import RLock
from typing import Any, Final, NoReturn

from bus.errors import ConfigurationError
from bus.types.classes import described_service
from bus.types.definitions import check_size, find_message, full_name
from bus.types.idl import PARTS
from bus_ros.rosidl import fields, setters
from bus_ros.rosidl.message import RosMessage

__all__ = ["action_class", "message_class", "module_of", "service_class"]

# Several threads may ask for a class at once, but each class must be made only once.
_lock: Final = RLock()
_classes: Final[dict[str, type[RosMessage]]] = {}
_wholes: Final[dict[str, type]] = {}
_open: Final[list[str]] = []


def message_class(name: str) -> type[RosMessage]:
    """The class of `std_msgs/msg/String`, or of a part: `std_srvs/srv/SetBool_Request`.

    Raises ConfigurationError if the definition is missing or malformed.
    """
    made = _classes.get(name)
    if made is None:
        with _lock:
            if name in _open:
                raise ConfigurationError(f"{name} contains itself: {' -> '.join([*_open, name])}")
            _open.append(name)
            try:
                made = _classes.get(name) or _classes.setdefault(name, _make(name))
            finally:
                _open.remove(name)
    return made


def service_class(name: str) -> type:
    """The class of `std_srvs/srv/SetBool`, with its `Request` and `Response`; errors as above."""
    return _whole(name, "srv", "Service", _ServiceType)


def action_class(name: str) -> type:
    """The class of `example_interfaces/action/Fibonacci`; errors as above.

    It has `Goal`, `Result`, `Feedback`, and `Impl` with the services and messages that carry them.
    """
    return _whole(name, "action", "Action", _ActionType)


class _ServiceType(type):
    """The type of service classes."""

    __type_name__: str

    def __getattr__(cls, name: str) -> Any:
        """The request or response class of a described service, made on access: most are never used."""
        if name not in PARTS["srv"] or "__described__" not in vars(cls):
            raise AttributeError(f"type object '{cls.__name__}' has no attribute '{name}'")
        made = message_class(f"{cls.__type_name__}_{name}")
        setattr(cls, name, made)
        return made

    @property
    def Event(cls) -> type[RosMessage]:
        """The class of the service's introspection events; made at its first use."""
        return message_class(f"{cls.__type_name__}_Event")


class _ActionType(type):
    """The type of action classes."""

    __type_name__: str

    @property
    def Impl(cls) -> type:
        """Made at its first use: most programs that import an action's package do not use it."""
        made = _wholes.get(f"{cls.__type_name__}_Impl")
        if made is None:
            made = _impl(cls.__type_name__)
            with _lock:
                made = _wholes.setdefault(f"{cls.__type_name__}_Impl", made)
        return made


def _impl(name: str) -> type:
    def service(part: str) -> type:
        return _made(
            f"{name}_{part}",
            "Service",
            type,
            {end: message_class(f"{name}_{part}_{end}") for end in PARTS["srv"]},
        )

    contents: dict[str, Any] = {
        "__module__": module_of(name),
        "__qualname__": f"{name.rpartition('/')[2]}.Impl",
        "SendGoalService": service("SendGoal"),
        "GetResultService": service("GetResult"),
        "FeedbackMessage": message_class(f"{name}_FeedbackMessage"),
        "CancelGoalService": service_class("action_msgs/srv/CancelGoal"),
        "GoalStatusMessage": message_class("action_msgs/msg/GoalStatusArray"),
    }
    return type("Impl", (), contents)


def module_of(name: str) -> str:
    """The module in which rosidl puts a type: `std_msgs.msg._string` for `std_msgs/msg/String`."""
    package, kind, short = name.split("/")
    short = short.partition("_")[0]
    parted = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", short)
    snake = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", parted).lower()
    return f"{package}.{kind}._{snake}"


def _whole(name: str, kind: str, what: str, metaclass: type) -> type:
    name = full_name(name)
    made = _wholes.get(name)
    if f"/{kind}/" not in name:
        raise ConfigurationError(f"{name} is no {what.lower()}")
    if made is None:
        described = described_service(name)
        contents: dict[str, Any] = {"__described__": described}
        if described is None:
            contents = {part: message_class(f"{name}_{part}") for part in PARTS[kind]}
        made = _made(name, what, metaclass, contents)
        with _lock:
            made = _wholes.setdefault(name, made)
    return made


def _made(name: str, what: str, metaclass: type, contents: Mapping[str, Any]) -> type:
    def __init__(self: object) -> NoReturn:
        raise NotImplementedError(f"{what} classes can not be instantiated")

    namespace = {"__init__": __init__, "__type_name__": name, "__module__": module_of(name), **contents}
    made: type = metaclass(name.rpartition("/")[2], (), namespace)
    return made


def _make(name: str) -> type[RosMessage]:
    definition = find_message(name)
    nested = {
        field.name: message_class(field.type.base) for field in definition.fields if "/" in field.type.base
    }
    mode = os.environ.get("ROS_PYTHON_CHECK_FIELDS")
    members = []
    for field in definition.fields:
        check_size(name, field)
        inner = nested.get(field.name)
        check = (
            fields.loose(field.type) if mode == "0" else fields.checker(field, inner, is_strict=mode == "1")
        )
        made_of = setters.member(field, inner, check)
        members.append(made_of._replace(usual=None) if mode == "0" else made_of)
    namespace: dict[str, object] = {
        "__slots__": [f"_{field.name}" for field in definition.fields],
        "__module__": module_of(name),
        "__type_name__": name,
        "__type_support__": classmethod(_type_support),
        "__reduce__": _reduce,
        "__definition__": definition,
        "__nested__": nested,
        "_fields_and_field_types": {field.name: fields.type_text(field.type) for field in definition.fields},
    }
    for field in definition.fields:
        if field.default is not None:
            namespace[f"{field.name.upper()}__DEFAULT"] = setters.plain_default(field)
    namespace |= {constant.name: constant.value for constant in definition.constants}
    native = setters.bases()
    cls: Any = type(name.rpartition("/")[2], (RosMessage, *native), namespace)
    (setters.add_native if native else setters.add_compiled)(
        cls, members, _ignored if mode == "0" else _strange
    )
    cls.__generated__ = cls
    made: type[RosMessage] = cls
    return made


def _type_support(cls: type[RosMessage]) -> object:
    """The `__type_support__` method for `bus.types.support.type_support`."""
    # Most messages are only made and read, so the modules for the wire are not imported earlier.
    from bus_ros.rosidl.support import support_of

    generated: Any = cls.__generated__  # the class is hashable, its instances are not
    return support_of(generated)


def _reduce(self: RosMessage) -> tuple[object, ...]:
    cls = type(self)
    # The class is pickled by its name: its module can be imported only if the import hook is installed.
    which = cls.__type_name__ if cls is cls.__generated__ else cls
    values = tuple(getattr(self, f"_{field.name}") for field in self.__definition__.fields)
    return _again, (which, values), getattr(self, "__dict__", None) or None


def _again(which: str | type[RosMessage], values: tuple[object, ...]) -> RosMessage:
    cls = message_class(which) if isinstance(which, str) else which
    made = cls.__new__(cls)
    for field, value in zip(cls.__definition__.fields, values, strict=True):
        setattr(made, f"_{field.name}", value)
    return made


def _strange(given: Mapping[str, object], known: frozenset[str]) -> None:
    unknown = sorted(given.keys() - known - {"check_fields"})
    if unknown:
        raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(unknown)}")


def _ignored(given: Mapping[str, object], known: frozenset[str]) -> None:
    """Accept unknown fields: nothing is checked."""

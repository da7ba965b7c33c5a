"""Classes by their names; programs import it as `rosidl_runtime_py.utilities`.

Owns: names as `NamespacedType`, and the kind of a class. Must not know: the making of classes.
"""

import warnings
from typing import Any, Final, NoReturn

from bus.errors import ConfigurationError
from bus.types.definitions import definition_path, find_path, full_name, packages
from bus.types.idl import CARRIERS, PARTS
from bus_ros.rosidl.classes import action_class, message_class, service_class
from bus_ros.rosidl.definition import NamespacedType

__all__ = [
    "get_action",
    "get_action_namespaced_type",
    "get_interface",
    "get_message",
    "get_message_namespaced_type",
    "get_namespaced_type",
    "get_service",
    "get_service_namespaced_type",
    "import_message_from_namespaced_type",
    "is_action",
    "is_message",
    "is_service",
]

_MAKERS: Final = {"msg": message_class, "srv": service_class, "action": action_class}
_PARTS: Final = {"srv": (*PARTS["srv"], "Event"), "action": (*PARTS["action"], *CARRIERS)}


def get_interface(identifier: str) -> type:
    """The class of `std_msgs/msg/String`, `std_srvs/srv/SetBool` or `example_interfaces/action/Fibonacci`.

    It may be a message of a service or an action: `std_srvs/srv/SetBool_Request`. Raises ValueError for an
    invalid name, ModuleNotFoundError for an unknown package, AttributeError for an unknown type,
    ConfigurationError for a malformed definition.
    """
    name = full_name(identifier)
    parts = name.split("/")
    if len(parts) != 3 or not all(parts) or parts[1] not in _MAKERS:
        raise ValueError(f"Expected the full name of an interface, got '{identifier}'")
    package, kind, short = parts
    whole, _, part = short.partition("_")
    if part in _PARTS.get(kind, ()) and find_path(f"{package}/{kind}/{whole}"):
        return message_class(name)
    if find_path(name) is None:
        _no_interface(name)
    return _MAKERS[kind](name)


def get_message(identifier: str) -> type:
    """The class of `std_msgs/msg/String` or `std_msgs/String`; raises as `get_interface`."""
    found = _interface(get_message_namespaced_type(identifier))
    if not is_message(found):
        raise ValueError(f"Expected the full name of a message, got '{identifier}'")
    return found


def get_service(identifier: str) -> type:
    """The class of `std_srvs/srv/SetBool` or `std_srvs/SetBool`; raises as `get_interface`."""
    found = _interface(get_service_namespaced_type(identifier))
    if not is_service(found):
        raise ValueError(f"Expected the full name of a service, got '{identifier}'")
    return found


def get_action(identifier: str) -> type:
    """The class of `example_interfaces/action/Fibonacci`; raises as `get_interface`."""
    found = _interface(get_action_namespaced_type(identifier))
    if not is_action(found):
        raise ValueError(f"Expected the full name of an action, got '{identifier}'")
    return found


def import_message_from_namespaced_type(message_type: Any) -> type:
    """The class of a NamespacedType; raises as above.

    An array or a sequence of messages is accepted too, with a DeprecationWarning.
    """
    if not isinstance(message_type, NamespacedType) and hasattr(message_type, "value_type"):
        text = "import_message_from_namespaced_type of an array is deprecated: pass its value_type"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        message_type = message_type.value_type
    return _interface(message_type)


def get_namespaced_type(identifier: str) -> NamespacedType:
    """The parts of a name, which need not exist."""
    return _namespaced_type(identifier, None)


def get_message_namespaced_type(identifier: str) -> NamespacedType:
    """As `get_namespaced_type`; `std_msgs/String` is `std_msgs/msg/String`."""
    return _namespaced_type(identifier, "msg")


def get_service_namespaced_type(identifier: str) -> NamespacedType:
    """As `get_namespaced_type`; `std_srvs/SetBool` is `std_srvs/srv/SetBool`."""
    return _namespaced_type(identifier, "srv")


def get_action_namespaced_type(identifier: str) -> NamespacedType:
    """As `get_namespaced_type`; `nav2_msgs/Spin` is `nav2_msgs/action/Spin`."""
    return _namespaced_type(identifier, "action")


def is_message(interface: object) -> bool:
    """Whether it is the class of a message."""
    return hasattr(interface, "SLOT_TYPES")


def is_service(interface: object) -> bool:
    """Whether it is the class of a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: object) -> bool:
    """Whether it is the class of an action."""
    return all(hasattr(interface, part) for part in PARTS["action"])


def _interface(named: NamespacedType) -> type:
    return get_interface("/".join(named.namespaced_name()))


def _namespaced_type(identifier: str, kind: str | None) -> NamespacedType:
    *namespaces, name = identifier.split("/")
    if len(namespaces) == 1 and kind is not None:
        namespaces.append(kind)
    return NamespacedType(namespaces, name)


def _no_interface(name: str) -> NoReturn:
    package, kind, short = name.split("/")
    if package not in packages():
        raise ModuleNotFoundError(f"No module named '{package}'", name=package)
    try:
        definition_path(name)
    except ConfigurationError as error:
        text = f"module '{package}.{kind}' has no attribute '{short}': {error}"
        raise AttributeError(text) from None
    raise AssertionError(name)  # the definition was found meanwhile

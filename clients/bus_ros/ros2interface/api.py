"""`ros2interface.api`: all definitions by name, and the fields of one as YAML."""

from typing import Any

from bus_ros.rosidl.interfaces import get_interface_packages, get_interfaces
from bus_ros.rosidl.runtime import message_to_yaml
from bus_ros.rosidl.utilities import get_interface, is_action, is_service

__all__ = ["interface_to_yaml", "package_name_completer", "type_completer"]


def package_name_completer(**kwargs: Any) -> dict[str, str]:
    """The packages that have definitions, and the prefix of each."""
    return get_interface_packages()


def type_completer(**kwargs: Any) -> list[str]:
    """All messages, services and actions that have a definition, sorted: `std_msgs/msg/String`."""
    return sorted(f"{package}/{name}" for package, names in get_interfaces().items() for name in names)


def interface_to_yaml(identifier: str) -> str:
    """The default values of a message, of a service's request or of an action's goal, as YAML.

    Raises ValueError for an invalid name, ModuleNotFoundError for an unknown package, AttributeError for an
    unknown type.
    """
    interface: Any = get_interface(identifier)
    if is_action(interface):
        interface = interface.Goal
    elif is_service(interface):
        interface = interface.Request
    return message_to_yaml(interface())

"""`ros2service.api`: names and types of services."""

from typing import Any

from bus_ros.rclpy.node import Node
from bus_ros.rclpy.validate_topic_name import topic_or_service_is_hidden
from bus_ros.rosidl.interfaces import get_service_interfaces
from bus_ros.rosidl.utilities import get_service

__all__ = [
    "get_service_class",
    "get_service_names",
    "get_service_names_and_types",
    "service_type_completer",
]


def get_service_names_and_types(
    *, node: Node, include_hidden_services: bool = False
) -> list[tuple[str, list[str]]]:
    """All services with their types. Unless included, hidden services are left out: a token of their name
    begins with `_`.
    """
    found = node.get_service_names_and_types()
    if include_hidden_services:
        return found
    return [(name, types) for name, types in found if not topic_or_service_is_hidden(name)]


def get_service_names(*, node: Node, include_hidden_services: bool = False) -> list[str]:
    """The names of all services; as `get_service_names_and_types`."""
    found = get_service_names_and_types(node=node, include_hidden_services=include_hidden_services)
    return [name for name, _ in found]


def get_service_class(node: Node, service_name: str, include_hidden_services: bool) -> type:
    """The class of a service by its full name.

    Raises RuntimeError for an unknown service, one with several types, or a type without definition.
    """
    found = get_service_names_and_types(node=node, include_hidden_services=include_hidden_services)
    types = dict(found).get(service_name)
    if types is None:
        raise RuntimeError(f"Cannot find type for '{service_name}'")
    if len(types) > 1:
        raise RuntimeError(f"More than one type associated with service '{service_name}'")
    try:
        return get_service(types[0])
    except (AttributeError, ModuleNotFoundError, ValueError):
        raise RuntimeError(f"The service type '{types[0]}' is invalid") from None


def service_type_completer(**kwargs: Any) -> list[str]:
    """All services that have a definition: `std_srvs/srv/Trigger`."""
    return [f"{package}/{name}" for package, names in get_service_interfaces().items() for name in names]

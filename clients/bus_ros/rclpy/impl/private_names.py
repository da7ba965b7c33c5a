"""Attributes of rclpy's nodes with an underscore that programs read nevertheless: `node._parameters`.

Looked up only if a node has no such attribute: a program may use these names itself. The values are copies,
except the lists of callbacks.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

__all__ = ["look_up"]


def _store(node: Any) -> Any:
    return vars(node)["_NodeParameters__store"]


def _descriptors(node: Any) -> dict[str, Any]:
    return {name: node.describe_parameter(name) for name in tuple(_store(node).declared)}


_NAMES: Final[Mapping[str, Callable[[Any], Any]]] = {
    "_clients": lambda node: list(node.clients),
    "_descriptors": _descriptors,
    "_guards": lambda node: list(node.guards),
    "_on_set_parameters_callbacks": lambda node: _store(node).on_set,
    "_parameters": lambda node: node.get_parameters_by_prefix(""),
    "_post_set_parameters_callbacks": lambda node: _store(node).post_set,
    "_pre_set_parameters_callbacks": lambda node: _store(node).pre_set,
    "_publishers": lambda node: list(node.publishers),
    "_services": lambda node: list(node.services),
    "_subscriptions": lambda node: list(node.subscriptions),
    "_timers": lambda node: list(node.timers),
}


def look_up(node: Any, name: str) -> Any:
    """An attribute that the node lacks. Raises AttributeError if rclpy's nodes lack it, too."""
    is_made = "_logger" in vars(node)
    if is_made and name in _NAMES:
        return _NAMES[name](node)
    hint = "" if is_made else ": super().__init__(node_name) has not been called"
    raise AttributeError(f"{type(node).__name__!r} object has no attribute {name!r}{hint}")

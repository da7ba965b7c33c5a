"""Modules of rclpy that only re-export the names of other modules: a table, and the finder that makes them.

Owns: the table, and the finder that makes `bus_ros.rclpy.qos_event` and the like. Must not know: the meaning
of the names, and the name under which programs import rclpy.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Final

from bus_ros.filled import Filled, spec_of

__all__ = ["MODULES", "install"]

_PACKAGE: Final = "bus_ros.rclpy."

_EVENTS: Final = (
    *("EventHandler", "IncompatibleTypeInfo", "QoSEventHandler"),
    *("QoSPublisherMatchedInfo", "QoSSubscriptionMatchedInfo"),
    *("PublisherEventCallbacks", "QoSLivelinessChangedInfo", "QoSLivelinessLostInfo", "QoSMessageLostInfo"),
    *("QoSOfferedDeadlineMissedInfo", "QoSOfferedIncompatibleQoSInfo", "QoSPublisherEventType"),
    *("QoSRequestedDeadlineMissedInfo", "QoSRequestedIncompatibleQoSInfo", "QoSSubscriptionEventType"),
    *("SubscriptionEventCallbacks", "UnsupportedEventTypeError"),
)
_ERRORS: Final = (
    *("InvalidHandle", "NodeNameNonExistentError", "RCLError", "RCLInvalidROSArgsError"),
    *("TimerCancelledError", "UnknownROSArgsError", "UnsupportedEventTypeError"),
)

MODULES: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "_rclpy_pybind11": ("exceptions", _ERRORS),
    "clock_type": ("time", ("ClockType",)),
    "constants": ("duration", ("S_TO_NS",)),
    "endpoint_info": (
        "topic_endpoint_info",
        ("EndpointTypeEnum", "ServiceEndpointInfo", "TopicEndpointInfo"),
    ),  # of Rolling
    "expand_topic_name": ("validate_topic_name", ("expand_topic_name",)),
    "experimental.events_executor": ("executors", ("EventsExecutor",)),
    "qos_event": ("event_handler", _EVENTS),  # of Humble
    "topic_or_service_is_hidden": (
        "validate_topic_name",
        ("HIDDEN_TOPIC_PREFIX", "topic_or_service_is_hidden"),
    ),
    "validate_full_topic_name": ("validate_topic_name", ("validate_full_topic_name",)),
    "validate_namespace": ("validate_topic_name", ("validate_namespace",)),
    "validate_node_name": ("validate_topic_name", ("validate_node_name",)),
    "validate_parameter_name": ("validate_topic_name", ("validate_parameter_name",)),
}
"""For each alias module: the module that defines the names, and the names."""


def install() -> None:
    """Install the finder: Python can then import these modules."""
    if _Finder not in sys.meta_path:
        sys.meta_path.append(_Finder)


class _Finder:
    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        short = name.removeprefix(_PACKAGE)
        if short == name or short not in MODULES:
            return None
        is_package = any(other.startswith(f"{short}.") for other in MODULES)
        return spec_of(name, Filled(_fill), is_package=is_package)


def _fill(module: ModuleType) -> None:
    target, names = MODULES[module.__name__.removeprefix(_PACKAGE)]
    source = vars(import_module(_PACKAGE + target))
    vars(module).update(
        {name: source[name] for name in names},
        __all__=list(names),
        __doc__=f"Names of `rclpy.{target}`, where programs of ROS 2 look for them, too.",
    )

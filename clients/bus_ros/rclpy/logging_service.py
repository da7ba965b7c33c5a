"""The two services by which other programs read and set the levels of a process' loggers.

A node has them if it is made with `enable_logger_service`. Must not know the transport of services.
"""

from typing import Any

from bus_ros.rclpy.impl.logging_severity import LoggingSeverity
from bus_ros.rclpy.logging import get_logger_effective_level, get_logger_level, set_logger_level
from bus_ros.rclpy.qos import qos_profile_services_default
from bus_ros.rclpy.validate_topic_name import TOPIC_SEPARATOR_STRING

__all__ = ["TOPIC_SEPARATOR_STRING", "LoggingService"]


class LoggingService:
    """Serves `<node>/get_logger_levels` and `<node>/set_logger_levels`."""

    def __init__(self, node: Any) -> None:
        from bus_ros.rosidl import message_class, service_class  # late: most nodes have none

        self._level: Any = message_class("rcl_interfaces/msg/LoggerLevel")
        self._result: Any = message_class("rcl_interfaces/msg/SetLoggerLevelsResult")
        for name, topic, answer in (
            ("GetLoggerLevels", "get_logger_levels", self._get),
            ("SetLoggerLevels", "set_logger_levels", self._set),
        ):
            node.create_service(
                service_class(f"rcl_interfaces/srv/{name}"),
                node.get_name() + TOPIC_SEPARATOR_STRING + topic,
                answer,
                qos_profile=qos_profile_services_default,
            )

    def _get(self, request: Any, response: Any) -> Any:
        """The level set for each name; for an empty name, the effective default of all loggers."""
        for name in request.names:
            level = get_logger_level(name) if name else get_logger_effective_level(name)
            response.levels.append(self._level(name=name, level=int(level)))
        return response

    def _set(self, request: Any, response: Any) -> Any:
        for one in request.levels:
            result = self._result(successful=True)
            try:
                set_logger_level(one.name, LoggingSeverity(one.level))
            except ValueError:
                result = self._result(reason="Failed reason: Invalid logger level.")
            response.results.append(result)
        return response

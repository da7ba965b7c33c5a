"""A status that several functions fill in."""

from typing import Any

from bus_ros.rosidl import message_class

__all__ = ["DiagnosticStatusWrapper"]

_DiagnosticStatus: Any = message_class("diagnostic_msgs/msg/DiagnosticStatus")
_KeyValue: Any = message_class("diagnostic_msgs/msg/KeyValue")
_OK: bytes = _DiagnosticStatus.OK


class DiagnosticStatusWrapper(_DiagnosticStatus):  # type: ignore[misc]
    """A diagnostic_msgs/msg/DiagnosticStatus with methods to fill it in."""

    def summary(self, *args: Any) -> None:
        """Set level and message: `summary(level, message)`, or both from another status."""
        self.level, message = _level_and_message(args)
        self.message = str(message)

    def clearSummary(self) -> None:
        """OK, without a message."""
        self.summary(_OK, "")

    def mergeSummary(self, *args: Any) -> None:
        """Add a level and a message, given as for `summary`.

        The higher level counts. If both are OK, or neither is, both messages stay, joined by a semicolon.
        Otherwise only the message that is not OK stays.
        """
        level, message = _level_and_message(args)
        if (level > _OK) == (self.level > _OK):
            self.message = f"{self.message}; {message}" if self.message else message
        elif level > self.level:
            self.message = message
        self.level = max(level, self.level)

    def add(self, key: str, val: object) -> None:
        """Add a value, as text, under a key."""
        self.values.append(_KeyValue(key=key, value=str(val)))


def _level_and_message(args: tuple[Any, ...]) -> tuple[bytes, Any]:
    if len(args) == 1:
        return args[0].level, args[0].message
    level, message = args
    return level, message

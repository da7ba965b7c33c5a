"""What a node logs, on the topic /rosout.

Owns: how a log entry becomes a message. Must not know: where entries come from.
"""

from typing import Any

from bus.logger import LogEntry
from bus.publisher import Publisher

__all__ = ["Rosout"]


class Rosout:
    """Publishes log entries by `publisher`, which is of rcl_interfaces/msg/Log."""

    def __init__(self, publisher: Publisher[Any]) -> None:
        self._publisher = publisher

    def publish(self, entry: LogEntry) -> None:
        """Does nothing once the publisher is closed."""
        from bus.msg.builtin_interfaces import Time
        from bus.msg.rcl_interfaces import Log

        if self._publisher._refusal is not None:
            return
        sec, nanosec = divmod(entry.stamp_ns, 1_000_000_000)
        self._publisher.publish(
            Log(
                stamp=Time(sec=sec, nanosec=nanosec),
                level=int(entry.severity),
                name=entry.name,
                msg=entry.text,
                file=entry.file,
                function=entry.function,
                line=entry.line,
            )
        )

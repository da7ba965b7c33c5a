"""Has turtlesim make a turtle, by a service that may not be there yet."""

from typing import Any

from bus_ros.rclpy.node import Node
from bus_ros.rosidl import service_class

__all__ = ["Spawner"]


class Spawner:
    """Asks for a turtle at x = 4, y = 2, once `is_there` is called."""

    def __init__(self, node: Node, name: str) -> None:
        self._log = node.get_logger()
        self._kind: Any = service_class("turtlesim/srv/Spawn")
        self._client = node.create_client(self._kind, "spawn")
        self._name = name
        self._answer: Any = None
        self._is_there = False

    def is_there(self) -> bool:
        """Whether the turtle is there. Does not wait; logs why not."""
        if self._is_there:
            return True
        if self._answer is None:
            if not self._client.service_is_ready():
                self._log.info("Service is not ready")
                return False
            self._answer = self._client.call_async(self._kind.Request(name=self._name, x=4.0, y=2.0))
        elif self._answer.done() and (error := self._answer.exception()) is not None:
            self._log.info(f"Spawn failed: {error}")
            self._answer = None  # perhaps turtlesim has ended, and comes again
        elif self._answer.done():
            # Without a name it is refused: a turtle of that name is there.
            self._log.info(f"Successfully spawned {self._answer.result().name or self._name}")
            self._is_there = True
        else:
            self._log.info("Spawn is not finished")
        return self._is_there

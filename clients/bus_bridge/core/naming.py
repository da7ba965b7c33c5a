"""Converts names between this bus and the wire: adds the namespace to leaving names, removes it from incoming
ones. Pure.

With the namespace `/bot1` the topic `/scan` of this bus is `/bot1/scan` on the wire, whatever publishes it.
Names on the wire without the namespace have no name here. So the conversion is unique in both directions.
"""

from bus.errors import ConfigurationError
from bus.names import MAX_NAMESPACE_LENGTH, MAX_TOPIC_NAME_LENGTH, absolute_namespace

__all__ = ["Naming"]


class Naming:
    """`namespace` may begin with a slash; "" and "/" change no name.

    Raises ConfigurationError if `namespace` is not valid.
    """

    def __init__(self, namespace: str = "") -> None:
        self.namespace: str = absolute_namespace(namespace)
        self._prefix = "" if self.namespace == "/" else self.namespace

    def topic_to_wire(self, topic: str) -> str:
        """Name of a topic on the wire. Raises ConfigurationError if it becomes too long."""
        return self._checked(topic, self._prefix + topic, MAX_TOPIC_NAME_LENGTH)

    def topic_from_wire(self, topic: str) -> str | None:
        """Name of a topic on this bus; None if it is outside of the namespace."""
        return topic[len(self._prefix) :] if topic.startswith(f"{self._prefix}/") else None

    def namespace_to_wire(self, namespace: str) -> str:
        """Namespace of a node on the wire. Raises ConfigurationError if it becomes too long."""
        if not self._prefix:
            return namespace
        full = self._prefix if namespace == "/" else self._prefix + namespace
        return self._checked(namespace, full, MAX_NAMESPACE_LENGTH)

    def namespace_from_wire(self, namespace: str) -> str | None:
        """Namespace of a node on this bus; None if it is outside of the namespace."""
        if namespace == self._prefix:
            return "/"
        return self.topic_from_wire(namespace)

    def _checked(self, name: str, full: str, limit: int) -> str:
        if len(full) > limit:
            raise ConfigurationError(
                f"with the namespace {self.namespace} in front, the name '{name}' has {len(full)} "
                f"characters; it may have {limit}"
            )
        return full

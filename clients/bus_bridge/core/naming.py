"""Names here and names on the wire: the namespace is added to leaving names and removed from incoming ones.
Pure.

With the namespace `/bot1` the topic `/scan` of this bus is `/bot1/scan` on the wire, whoever publishes it.
Names on the wire that don't begin with it have no name here, so each name here has one there and back again.
"""

from bus.errors import ConfigurationError
from bus.names import MAX_NAMESPACE_LENGTH, MAX_TOPIC_NAME_LENGTH, absolute_namespace

__all__ = ["Naming"]


class Naming:
    """`namespace` with or without a slash in front; "" and "/" change no name.

    Raises ConfigurationError for what is no namespace.
    """

    def __init__(self, namespace: str = "") -> None:
        self.namespace: str = absolute_namespace(namespace)
        self._prefix = "" if self.namespace == "/" else self.namespace

    def topic_to_wire(self, topic: str) -> str:
        """Raises ConfigurationError if the name becomes too long."""
        return self._checked(topic, self._prefix + topic, MAX_TOPIC_NAME_LENGTH)

    def topic_from_wire(self, topic: str) -> str | None:
        """None if it lies outside of the namespace."""
        return topic[len(self._prefix) :] if topic.startswith(f"{self._prefix}/") else None

    def namespace_to_wire(self, namespace: str) -> str:
        """Of a node. Raises ConfigurationError if it becomes too long."""
        if not self._prefix:
            return namespace
        full = self._prefix if namespace == "/" else self._prefix + namespace
        return self._checked(namespace, full, MAX_NAMESPACE_LENGTH)

    def namespace_from_wire(self, namespace: str) -> str | None:
        """Of a node. None if it lies outside of the namespace."""
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

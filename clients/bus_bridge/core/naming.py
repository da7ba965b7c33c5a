"""Converts names between this bus and the wire: adds the namespace to leaving names, removes it from incoming
ones, and applies the far names of the rules. Pure.

With the namespace `/bot1` the topic `/scan` of this bus is `/bot1/scan` on the wire, whatever publishes it.
With the far name `/front/scan` it is `/front/scan` there. Names on the wire without the namespace have no
name here. If a far name equals the wire name of another topic, that topic has no name on the wire. So the
conversion is unique in both directions: no topic returns under another name.
"""

from collections.abc import Mapping

from bus.errors import ConfigurationError
from bus.names import MAX_NAMESPACE_LENGTH, MAX_TOPIC_NAME_LENGTH, absolute_namespace
from bus_bridge.core.rules import subject_of

__all__ = ["Naming"]


class Naming:
    """`namespace` may begin with a slash; "" and "/" change no name.

    `far_names` has names of the far side by names of this bus, as of `Rules`. Raises ConfigurationError if
    `namespace` is not valid.
    """

    def __init__(self, namespace: str = "", far_names: Mapping[str, str] | None = None) -> None:
        self.namespace: str = absolute_namespace(namespace)
        self._prefix = "" if self.namespace == "/" else self.namespace
        self._far_names = dict(far_names or {})
        self._here = {far: here for here, far in self._far_names.items()}

    def topic_to_wire(self, topic: str) -> str:
        """Name of a topic on the wire. Raises ConfigurationError if it has none, or if it becomes too
        long."""
        subject = subject_of(topic)
        far = self._far_names.get(subject)
        if far is not None:
            return self._checked(topic, far + topic[len(subject) :], MAX_TOPIC_NAME_LENGTH)
        if (taken := self._here.get(self._prefix + subject)) is not None:
            raise ConfigurationError(f"a rule has '{self._prefix + subject}' as the far_name of '{taken}'")
        return self._checked(topic, self._prefix + topic, MAX_TOPIC_NAME_LENGTH)

    def topic_from_wire(self, topic: str) -> str | None:
        """Name of a topic on this bus; None if it has none."""
        subject = subject_of(topic)
        here = self._here.get(subject)
        if here is not None:
            return here + topic[len(subject) :]
        found = self._without_prefix(topic)
        return None if found is None or subject_of(found) in self._far_names else found

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
        return self._without_prefix(namespace)

    def _without_prefix(self, name: str) -> str | None:
        return name[len(self._prefix) :] if name.startswith(f"{self._prefix}/") else None

    def _checked(self, name: str, full: str, limit: int) -> str:
        if len(full) > limit:
            how = (
                "its far_name" if full != self._prefix + name else f"the namespace {self.namespace} in front"
            )
            raise ConfigurationError(
                f"with {how}, the name '{name}' has {len(full)} characters; it may have {limit}"
            )
        return full

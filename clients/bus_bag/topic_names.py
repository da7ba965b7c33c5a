"""Names of topics and services as users write them, and the topics of services' events. Pure."""

import re
from collections.abc import Iterable
from re import Pattern

from bus.errors import ConfigurationError

__all__ = ["SERVICE_EVENT", "absolute", "absolute_names", "compiled", "event_topics", "is_event_topic"]

SERVICE_EVENT = "/_service_event"
"""The end of the name of a topic with a service's events."""


def absolute(name: str) -> str:
    """The full name: a name without a slash in front belongs to the root namespace."""
    return name if name.startswith("/") else f"/{name}"


def absolute_names(names: Iterable[str]) -> frozenset[str]:
    return frozenset(map(absolute, names))


def event_topics(services: Iterable[str]) -> frozenset[str]:
    """The topics of the events of these services."""
    return frozenset(name + SERVICE_EVENT for name in absolute_names(services))


def is_event_topic(topic: str, types: Iterable[str]) -> bool:
    """Whether a topic with messages of these types has the events of a service."""
    return topic.endswith(SERVICE_EVENT) and all("/srv/" in one and one.endswith("_Event") for one in types)


def compiled(pattern: str) -> Pattern[str] | None:
    """Compile a regular expression; None for an empty text. Raises ConfigurationError if it is not valid."""
    if not pattern:
        return None
    try:
        return re.compile(pattern)
    except re.error as error:
        raise ConfigurationError(f"'{pattern}' is not a regular expression: {error}") from None

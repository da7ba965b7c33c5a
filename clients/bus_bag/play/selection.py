"""Which topics of a bag are played. Pure.

As rosbag2's player: excluding comes first; topics and the regular expression add up; what is named of topics
says nothing of services, whose events stand on topics of their own; a regular expression fits a whole name.
"""

import re
from collections.abc import Iterable
from re import Pattern

__all__ = ["Selection"]

_EVENTS = "/_service_event"


class Selection:
    """What `--topics`, `--services`, `--regex` and their opposites choose; nothing given: all.

    Names without a slash in front are those of the root namespace. Raises ValueError for what is no regular
    expression.
    """

    def __init__(
        self,
        *,
        topics: Iterable[str] = (),
        services: Iterable[str] = (),
        regex: str = "",
        exclude_topics: Iterable[str] = (),
        exclude_services: Iterable[str] = (),
        exclude_regex: str = "",
    ) -> None:
        self.topics = frozenset(_absolute(topics))
        """Those that were named."""
        self._services = frozenset(_events(services))
        self._excluded = _absolute(exclude_topics) | _events(exclude_services)
        self._regex = _compiled(regex)
        self._exclude_regex = _compiled(exclude_regex)

    def has(self, topic: str) -> bool:
        """Whether this topic is played."""
        if topic in self._excluded or (self._exclude_regex and self._exclude_regex.fullmatch(topic)):
            return False
        named = self._services if topic.endswith(_EVENTS) else self.topics
        if not named and not self._regex:
            return True
        return topic in named or bool(self._regex and self._regex.fullmatch(topic))


def _absolute(names: Iterable[str]) -> set[str]:
    return {name if name.startswith("/") else f"/{name}" for name in names}


def _events(services: Iterable[str]) -> set[str]:
    return {name + _EVENTS for name in _absolute(services)}


def _compiled(pattern: str) -> Pattern[str] | None:
    if not pattern:
        return None
    try:
        return re.compile(pattern)
    except re.error as error:
        raise ValueError(f"'{pattern}' is no regular expression: {error}") from None

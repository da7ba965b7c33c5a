"""The choice of the topics to play. Pure.

The rules are the same as in rosbag2's player: exclusions come first. Topics and the regular expression add
up. Options for topics don't choose services, because their events are on other topics. A regular expression
must match the whole name.
"""

from collections.abc import Collection, Iterable

from bus_bag.errors import BagError
from bus_bag.topic_names import SERVICE_EVENT, absolute_names, compiled, event_topics

__all__ = ["Selection"]

_MOST = 10
"""Number of names in an error."""


class Selection:
    """The choice by `--topics`, `--services`, `--regex` and their opposites; without options: all.

    Names without a slash in front belong to the root namespace. Raises ConfigurationError for an invalid
    regular expression.
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
        self.topics = absolute_names(topics)
        """Topics chosen by name."""
        self._services = event_topics(services)
        self._excluded = absolute_names(exclude_topics) | event_topics(exclude_services)
        self._regex = compiled(regex)
        self._exclude_regex = compiled(exclude_regex)

    def check(self, topics: Collection[str]) -> None:
        """Raise BagError if it chooses none of `topics`, the topics of a bag, or if none of its services has
        events there."""
        events = [topic for topic in topics if topic.endswith(SERVICE_EVENT)]
        if self._services and self._services.isdisjoint(events):
            named = ", ".join(sorted(topic.removesuffix(SERVICE_EVENT) for topic in self._services))
            known = _listed([topic.removesuffix(SERVICE_EVENT) for topic in events])
            raise BagError(f"Nothing to play of {named}: the bag has events of {known or 'no service'}")
        if topics and not any(map(self.has, topics)):
            raise BagError(
                f"Nothing to play: the options choose no topic of the bag. It has {_listed(topics)}"
            )

    def has(self, topic: str) -> bool:
        """Whether this topic is played."""
        if topic in self._excluded or (self._exclude_regex and self._exclude_regex.fullmatch(topic)):
            return False
        named = self._services if topic.endswith(SERVICE_EVENT) else self.topics
        if not named and not self._regex:
            return True
        return topic in named or bool(self._regex and self._regex.fullmatch(topic))


def _listed(names: Collection[str]) -> str:
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join([*names][:_MOST]) + more

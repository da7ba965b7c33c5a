"""The choice of the topics to record: applies the options to a graph. Pure.

The rules are the same as in rosbag2's topic filter. Names, types and the regular expression add up; excluded
topics and hidden topics are removed from the result. Events of services are on other topics, which options
for topics don't choose. For a user, the topics of service calls are not topics.
"""

from collections.abc import Iterable

import msgspec

from bus.graph import Graph, GraphEndpoint
from bus.names import is_hidden_topic, service_of_topic
from bus_bag.topic_names import compiled, event_topics, is_event_topic

__all__ = ["Choice", "Found", "Wanted"]


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """The choice by the options of `bus bag record`. Names have a slash in front."""

    topics: frozenset[str] = frozenset()
    services: frozenset[str] = frozenset()
    topic_types: frozenset[str] = frozenset()
    regex: str = ""
    all_topics: bool = False
    all_services: bool = False
    exclude_topics: frozenset[str] = frozenset()
    exclude_services: frozenset[str] = frozenset()
    exclude_topic_types: frozenset[str] = frozenset()
    exclude_regex: str = ""
    include_hidden_topics: bool = False
    include_unpublished_topics: bool = False
    ignore_leaf_topics: bool = False

    @property
    def is_by_name(self) -> bool:
        """Whether the search ends once all named topics are found."""
        return not (self.topic_types or self.regex or self.all_topics or self.all_services)


class Found(msgspec.Struct, frozen=True):
    """A topic to record."""

    topic: str
    type_name: str
    type_hash: str


class Choice:
    """Chooses for one recorder, whose node has the name `own_node`.

    Raises ConfigurationError for an invalid regular expression.
    """

    def __init__(self, wanted: Wanted, own_node: str) -> None:
        self._wanted = wanted
        self._own_node = own_node
        self._events = event_topics(wanted.services)
        self._excluded_events = event_topics(wanted.exclude_services)
        self._regex = compiled(wanted.regex)
        self._exclude_regex = compiled(wanted.exclude_regex)
        self._said: set[str] = set()

    def choose(self, graph: Graph) -> tuple[list[Found], list[str]]:
        """The topics to record, sorted by name, and the reasons why other wanted topics are left out, each
        reported once."""
        found, reasons = [], []
        types: dict[str, set[tuple[str, str]]] = {}
        for endpoint in graph.publishers:
            types.setdefault(endpoint.topic, set()).add((endpoint.type_name, endpoint.type_hash))
        heard: dict[str, list[GraphEndpoint]] = {}
        for endpoint in graph.subscriptions:
            heard.setdefault(endpoint.topic, []).append(endpoint)
        if self._wanted.include_unpublished_topics:
            for topic, endpoints in heard.items():
                if topic not in types:
                    types[topic] = {(one.type_name, one.type_hash) for one in endpoints}
        for topic, kinds in sorted(types.items()):
            if self._wanted.ignore_leaf_topics and not self._has_others(heard.get(topic, ())):
                continue
            names = {name for name, _ in kinds}
            if service_of_topic(topic) is not None or not self._wants(topic, names):
                continue
            if self._is_hidden(topic, names):
                reason = "Hidden topics are not recorded. Enable them with --include-hidden-topics"
            elif len(kinds) > 1:
                reason = (
                    f"Topic '{topic}' has more than one type associated. "
                    "Only topics with one type are supported"
                )
            else:
                ((type_name, type_hash),) = kinds
                found.append(Found(topic, type_name, type_hash))
                continue
            if reason not in self._said:
                self._said.add(reason)
                reasons.append(reason)
        return found, reasons

    def is_complete(self, recorded: Iterable[str]) -> bool:
        """Whether all named topics are recorded, and no others are wanted."""
        return self._wanted.is_by_name and (self._wanted.topics | self._events) <= set(recorded)

    def takes(self, topic: str, types: set[str]) -> bool:
        """Whether a topic with messages of these types is chosen, from any source."""
        return self._wants(topic, types) and not self._is_hidden(topic, types)

    def _is_hidden(self, topic: str, types: set[str]) -> bool:
        """Whether the topic is left out because of its name. Events of services never are."""
        if self._wanted.include_hidden_topics:
            return False
        return is_hidden_topic(topic) and not is_event_topic(topic, types)

    def _has_others(self, subscriptions: Iterable[GraphEndpoint]) -> bool:
        return any(one.node.full_name != self._own_node for one in subscriptions)

    def _wants(self, topic: str, types: set[str]) -> bool:
        wanted = self._wanted
        is_event = is_event_topic(topic, types)
        if self._exclude_regex is not None and self._exclude_regex.search(topic):
            return False
        if is_event:
            if topic in self._excluded_events:
                return False
            is_named = wanted.all_services or topic in self._events
        else:
            if topic in wanted.exclude_topics or types & wanted.exclude_topic_types:
                return False
            is_named = wanted.all_topics or topic in wanted.topics or bool(types & wanted.topic_types)
        return is_named or (self._regex is not None and bool(self._regex.search(topic)))

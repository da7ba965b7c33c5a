"""The played topics of a bag: their types, their publishers, and the decoding of their messages."""

from collections import Counter
from typing import Any

from bus.base.counted import counted
from bus.base.suggest import did_you_mean
from bus.errors import BusError, ConfigurationError
from bus.logger import Logger
from bus.node import Node
from bus.publisher import Publisher
from bus.qos import QoSProfile, Reliability
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag.metadata import TopicMetadata
from bus_bag.play.options import PlayOptions
from bus_bag.play.qos import MIXED, kept_for_late_joiners, offered_profile
from bus_bag.play.requests import ServiceRequests
from bus_bag.schemas import SCHEMA, schema_from_text
from bus_bag.storage import BagMessage, JoinedBags
from bus_bag.topic_names import is_event_topic
from bus_ros.cdr import CdrError, Codec, codec_of, schema_of_definition

__all__ = ["Topics"]

_CDR = "cdr"
_CLOCK = "/clock"


class Topics:
    """The topics of `bags` that `options` choose."""

    def __init__(self, bags: JoinedBags, options: PlayOptions, logger: Logger) -> None:
        self._bags = bags
        self._options = options
        self._logger = logger
        self._codecs: dict[str, Codec] = {}
        self._undecodable: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self.depths: dict[str, int] = {}
        """Transient local topics, and the number of messages that a late joiner gets from each."""

    @property
    def names(self) -> frozenset[str]:
        """Names of all playable topics."""
        return frozenset(self._codecs)

    async def publish_on(self, node: Node) -> dict[str, Publisher[Any] | ServiceRequests]:
        """Create a publisher for each playable topic, and log the reason for each other topic.

        If the options choose a source of requests, a service's events have a client instead.
        """
        publishers: dict[str, Publisher[Any] | ServiceRequests] = {}
        best_effort = []
        self._report_unknown()
        source = self._options.requests_source
        graph = await node.graph() if source else None
        for name, topic in self._bags.topics.items():
            if not self._options.selection.has(name) or (name == _CLOCK and self._options.has_clock):
                continue
            profile = self._profile(topic)
            try:
                schema = self._schema(topic)
                codec = codec_of(schema)
                if source and graph is not None and is_event_topic(name, [topic.type]):
                    publishers[name] = await ServiceRequests.open(node, graph, name, schema, source)
                    self._codecs[name] = codec
                    continue
                publishers[name] = await node.create_publisher(schema, name, profile)
            except BusError as error:
                reason = str(error).splitlines()[0].rstrip(".:")
                self._logger.warning(f"Ignoring a topic '{name}', reason: {reason}.")
                continue
            self._codecs[name] = codec
            depth = kept_for_late_joiners(topic.offered_qos_profiles) or kept_for_late_joiners([profile])
            if depth:
                self.depths[name] = depth
            if profile.reliability is Reliability.BEST_EFFORT:
                best_effort.append(name)
        if best_effort and self._options.acknowledged_within is not None:
            self._logger.warning(
                "--wait-for-all-acked is invalid for the below topics since reliability of QOS is "
                f"BestEffort.\n{', '.join(best_effort)}"
            )
        return publishers

    def decode(self, message: BagMessage) -> bytes | None:
        """The payload of a message; None if it does not have its type. Not for several threads at a time."""
        try:
            return self._codecs[message.topic].decode(message.data)
        except CdrError as error:
            self._undecodable[message.topic] += 1
            self._reasons.setdefault(message.topic, str(error))
            return None

    def report_undecodable(self) -> None:
        """Log the number of skipped messages."""
        for topic, count in self._undecodable.items():
            self._logger.warning(f"{counted(count, 'message')} of '{topic}' left out: {self._reasons[topic]}")

    def _report_unknown(self) -> None:
        for name in self._options.selection.topics:
            if name not in self._bags.topics:
                self._logger.warning(
                    f"Topic '{name}' is not in the bag{did_you_mean(name, self._bags.topics)}"
                )

    def _profile(self, topic: TopicMetadata) -> QoSProfile:
        override = self._options.overrides.get(topic.name)
        if override is not None:
            self._logger.info(f"Overriding QoS profile for topic {topic.name}")
            return override
        profile, is_mixed = offered_profile(topic.offered_qos_profiles)
        if is_mixed:
            self._logger.warning(MIXED.format(topic=topic.name))
        return profile

    def _schema(self, topic: TopicMetadata) -> MessageSchema:
        """The schema recorded by busd; without it, the definition in the file; without both, the local
        type."""
        if topic.serialization_format != _CDR:
            raise ConfigurationError(f"serialization format '{topic.serialization_format}' is not supported")
        text = self._bags.extra_of(topic.name).get(SCHEMA)
        if text:
            return schema_from_text(text)
        definition = self._bags.definition_of(topic.name)
        if definition:
            return schema_of_definition(topic.type, definition)
        return MessageSchema.of(message_class(topic.type))

"""Measures one topic: number and age of messages, and losses by node."""

from statistics import fmean
from time import monotonic
from typing import Any

import bus
from common import Topic, TopicHealth, seconds_of


class Meter:
    """Counts the messages of one topic from report to report."""

    def __init__(self, topic: Topic[Any]) -> None:
        self.topic = topic
        self._publisher = b""
        self._number = 0
        self._start()

    def count(self, message: Any, info: bus.MessageInfo) -> None:
        if info.publisher_gid == self._publisher:
            self._published += info.publication_sequence_number - self._number
        else:
            self._published += 1
        self._publisher, self._number = info.publisher_gid, info.publication_sequence_number
        self._ages_s.append((info.received_timestamp - info.source_timestamp) / 1e9)
        if hasattr(message, "header"):
            self._stamp_ages_s.append(info.received_timestamp / 1e9 - seconds_of(message.header.stamp))

    def report(self, lost: dict[str, int]) -> TopicHealth:
        ages_s, stamp_ages_s = self._ages_s, self._stamp_ages_s
        health = TopicHealth(
            topic=self.topic.name,
            nominal_hz=self.topic.rate_hz,
            window_s=monotonic() - self._started_s,
            published=self._published,
            received=len(ages_s),
            age_s=fmean(ages_s) if ages_s else None,
            age_max_s=max(ages_s, default=None),
            stamp_age_s=fmean(stamp_ages_s) if stamp_ages_s else None,
            lost=lost,
        )
        self._start()
        return health

    def _start(self) -> None:
        self._started_s = monotonic()
        self._published = 0
        self._ages_s: list[float] = []
        self._stamp_ages_s: list[float] = []


def lost_on(graph: bus.Graph, topic: str) -> dict[str, int]:
    """Lost messages of `topic` by node and reason."""
    return {
        f"{endpoint.node.name}: {reason}": count
        for endpoint in (*graph.publishers_of(topic), *graph.subscriptions_of(topic))
        if endpoint.statistics is not None
        for reason, count in endpoint.statistics.dropped.items()
    }

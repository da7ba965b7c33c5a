"""Sums of endpoints' counters by topic and node. They only grow, and include endpoints that are gone.

Pure. Must not know how the counters are requested, or how the sums are written. Everything here is bounded:
names that come and go for months must not fill the memory of this process.
"""

from collections.abc import Iterable, Mapping

from bus.graph import EndpointStatistics, GraphEndpoint

__all__ = ["Labels", "Sums", "Totals"]

Labels = tuple[str, ...]
"""Subject of a row: a topic, a topic and a node, ..."""

_MOST_GONE = 16_384
"""Most endpoints that are gone but remembered: after a restart of busd they come back with their totals."""


class Sums:
    """Counters by label values, in at most `most` rows.

    If the subject of a row goes, the row stays until its place is needed. The subject that has been gone for
    the longest time loses its row first. `left_out` is the number of subjects without a row.
    """

    def __init__(self, most: int) -> None:
        self.rows: dict[Labels, int] = {}
        self.left_out = 0
        self._most = most

    def add(self, amounts: Mapping[Labels, int]) -> None:
        """Add the growth since the last call for all subjects that are present now, also a growth of 0."""
        gone = self.rows
        here = {labels: gone.pop(labels) + amount for labels, amount in amounts.items() if labels in gone}
        new = [labels for labels in amounts if labels not in here]
        room = self._most - len(here)
        here |= {labels: amounts[labels] for labels in new[:room]}
        self.left_out = len(new[room:])
        kept = [*gone.items()][max(0, len(gone) + len(here) - self._most) :]
        self.rows = {**dict(kept), **here}


class Totals:
    """Sums of the counters of a bus's endpoints, at most `most` rows of each kind."""

    def __init__(self, most: int) -> None:
        self.messages, self.bytes = Sums(most), Sums(most)
        """Published messages and bytes, by topic."""
        self.expected = Sums(most)
        """Messages published to subscriptions since their matches, by topic and node."""
        self.delivered, self.delivered_bytes = Sums(most), Sums(most)
        """Messages and bytes that programs have taken, by topic and node."""
        self.dropped, self.dropped_early = Sums(most), Sums(most)
        """Messages lost for subscriptions, and replaced at publishers, by topic, node and reason."""
        self.lost = Sums(most)
        """Messages lost for subscriptions, by topic and node. Starts with 0, so the first loss shows."""
        self._heard: dict[tuple[bytes, int], EndpointStatistics] = {}

    def take(self, publishers: Iterable[GraphEndpoint], subscriptions: Iterable[GraphEndpoint]) -> None:
        """Add the growth of all counters. The arguments are all endpoints at one moment, with statistics.

        A counter that is lower than before, as right after a restart of busd, keeps its old value.
        """
        sent, taken = _Amounts(), _Amounts()
        heard: dict[tuple[bytes, int], EndpointStatistics] = {}
        for amounts, endpoints in ((sent, publishers), (taken, subscriptions)):
            for endpoint in endpoints:
                # A restarted bridge has the same gids, but counts from 0.
                key = endpoint.gid, endpoint.node.pid if endpoint.node.origin is not None else 0
                before = self._heard.get(key) or EndpointStatistics()
                after = heard[key] = _highest(before, endpoint.statistics or before)
                amounts.add(endpoint, before, after)
        gone = [(key, totals) for key, totals in self._heard.items() if key not in heard]
        self._heard = {**dict(gone[-_MOST_GONE:]), **heard}
        self.messages.add(sent.by_topic(sent.samples))
        self.bytes.add(sent.by_topic(sent.bytes))
        self.dropped_early.add(sent.dropped)
        self.expected.add(taken.expected)
        self.delivered.add(taken.samples)
        self.delivered_bytes.add(taken.bytes)
        self.dropped.add(taken.dropped)
        self.lost.add(taken.lost)


class _Amounts:
    """Growth of the counters between two moments."""

    def __init__(self) -> None:
        self.samples: dict[Labels, int] = {}
        self.bytes: dict[Labels, int] = {}
        self.expected: dict[Labels, int] = {}
        self.dropped: dict[Labels, int] = {}
        self.lost: dict[Labels, int] = {}

    def add(self, endpoint: GraphEndpoint, before: EndpointStatistics, after: EndpointStatistics) -> None:
        labels = (endpoint.topic, endpoint.node.full_name)
        self.samples[labels] = self.samples.get(labels, 0) + after.samples - before.samples
        self.bytes[labels] = self.bytes.get(labels, 0) + after.bytes - before.bytes
        self.expected[labels] = self.expected.get(labels, 0) + after.expected - before.expected
        lost = 0
        for reason, count in after.dropped.items():
            row, more = (*labels, reason), count - before.dropped.get(reason, 0)
            self.dropped[row] = self.dropped.get(row, 0) + more
            lost += more
        self.lost[labels] = self.lost.get(labels, 0) + lost

    @staticmethod
    def by_topic(amounts: Mapping[Labels, int]) -> dict[Labels, int]:
        found: dict[Labels, int] = {}
        for (topic, _), amount in amounts.items():
            found[(topic,)] = found.get((topic,), 0) + amount
        return found


def _highest(before: EndpointStatistics, now: EndpointStatistics) -> EndpointStatistics:
    dropped = {
        reason: max(before.dropped.get(reason, 0), now.dropped.get(reason, 0))
        for reason in {**before.dropped, **now.dropped}
    }
    return EndpointStatistics(
        samples=max(before.samples, now.samples),
        bytes=max(before.bytes, now.bytes),
        dropped=dropped,
        expected=max(before.expected, now.expected),
    )

"""Sums that only grow: what endpoints count, added up by topic and node, also of those that are gone.

Pure. Must not know how the sums are asked for or written. Everything here is bounded: a bus on which names
come and go for months must not fill the memory of the process that watches.
"""

from collections.abc import Iterable, Mapping

from bus.graph import EndpointStatistics, GraphEndpoint

__all__ = ["Labels", "Sums", "Totals"]

Labels = tuple[str, ...]
"""What a row is about: a topic; a topic and a node; ..."""

_MOST_GONE = 16_384
"""Endpoints that are gone and remembered: after a restart of busd they come back with their totals."""


class Sums:
    """Counters by label values, `most` rows at most.

    A row stays when what it is about goes, until its place is needed; the longest gone goes first. What finds
    no place is `left_out`.
    """

    def __init__(self, most: int) -> None:
        self.rows: dict[Labels, int] = {}
        self.left_out = 0
        self._most = most

    def add(self, amounts: Mapping[Labels, int]) -> None:
        """All that is there at one moment, with what it has counted since the last; 0 where it is nothing."""
        gone = self.rows
        here = {labels: gone.pop(labels) + amount for labels, amount in amounts.items() if labels in gone}
        new = [labels for labels in amounts if labels not in here]
        room = self._most - len(here)
        here |= {labels: amounts[labels] for labels in new[:room]}
        self.left_out = len(new[room:])
        kept = [*gone.items()][max(0, len(gone) + len(here) - self._most) :]
        self.rows = {**dict(kept), **here}


class Totals:
    """What the endpoints of a bus have counted, `most` rows of each kind."""

    def __init__(self, most: int) -> None:
        self.messages, self.bytes = Sums(most), Sums(most)
        """Published, by topic."""
        self.expected = Sums(most)
        """Published to subscriptions since their matches, by topic and node."""
        self.delivered, self.delivered_bytes = Sums(most), Sums(most)
        """Of these, taken by programs."""
        self.dropped, self.dropped_early = Sums(most), Sums(most)
        """Lost for subscriptions, and replaced at publishers, by topic, node and reason."""
        self.lost = Sums(most)
        """What subscriptions lost, by topic and node; 0 where nothing was, so that the first loss shows."""
        self._heard: dict[tuple[bytes, int], EndpointStatistics] = {}

    def take(self, publishers: Iterable[GraphEndpoint], subscriptions: Iterable[GraphEndpoint]) -> None:
        """All endpoints of one moment, with their statistics.

        A total that is lower than before, as right after a restart of busd, counts from where it was.
        """
        sent, taken = _Amounts(), _Amounts()
        heard: dict[tuple[bytes, int], EndpointStatistics] = {}
        for amounts, endpoints in ((sent, publishers), (taken, subscriptions)):
            for endpoint in endpoints:
                # A bridge that is made anew brings the same gids, and counts from 0.
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
    """What was counted between two moments."""

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

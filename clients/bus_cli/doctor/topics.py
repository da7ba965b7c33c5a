"""Publishers and subscriptions of one topic that do not match."""

from collections.abc import Iterator
from typing import NamedTuple

from bus.base.counted import counted
from bus.diagnostics.mismatch import kept_apart, mismatch
from bus.graph import Graph, GraphEndpoint
from bus_cli.doctor.finding import Finding, ok, warn

__all__ = ["Pair", "examine", "pairs"]

_MOST = 10
"""Most lines; a large system with a wrong profile would have thousands."""


class Pair(NamedTuple):
    """A publisher and a subscription of one topic; `reason` is empty if they match."""

    publisher: GraphEndpoint
    subscription: GraphEndpoint
    reason: str


def pairs(graph: Graph) -> Iterator[Pair]:
    """All pairs of a topic, except pairs that bridges keep apart."""
    for publisher in sorted(graph.publishers, key=lambda one: (one.topic, one.node.full_name)):
        for subscription in graph.subscriptions_of(publisher.topic):
            if not kept_apart(publisher, subscription):
                reason = mismatch(publisher, subscription, lambda *_: None) or ""
                yield Pair(publisher, subscription, reason)


def examine(graph: Graph) -> Iterator[Finding]:
    found = list(pairs(graph))
    wrong = [pair for pair in found if pair.reason]
    for publisher, subscription, reason in wrong[:_MOST]:
        ends = f"{publisher.node.full_name} and {subscription.node.full_name}"
        text = f"{publisher.topic}: {ends} do not match: {reason}"
        yield warn("topics", text, f"bus topic info -v {publisher.topic}")
    if len(wrong) > _MOST:
        yield warn("topics", f"{counted(len(wrong) - _MOST, 'further pair')} without a match")
    if not wrong:
        text = f"{counted(len(found), 'pair')} of a publisher and a subscription, all match"
        yield ok("topics", text)

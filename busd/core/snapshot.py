"""The graph as one answer: taken at one moment, put together in pieces.

Only the tables are copied at once, which is quick. Making and encoding the records takes long, so busd does
it in pieces. A record never changes, except its statistics, which are of the moment when it is made.
"""

from collections.abc import Container, Generator, Iterable, Iterator
from itertools import islice
from operator import attrgetter
from typing import Any, TypeVar

from bus.wire.codec import ArrayEncoder
from bus.wire.messages import GraphSnapshot, MatchRecord
from busd.core.entities import ROUTE_OF, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.work import LOOKS_PER_UNIT, RECORD

__all__ = ["take_snapshot"]

_T = TypeVar("_T")
_PIECE = 32
_STATE = attrgetter("state")


def take_snapshot(
    graph: Graph,
    request: int,
    *,
    statistics: bool,
    pid: int,
    shown: tuple[Container[int], Container[int]] | None = None,
) -> Generator[int, int, GraphSnapshot]:
    """Everything, or only the `shown` nodes and endpoints, as the answer to `request`.

    Changes after the first step are not in it.
    """
    revision = graph.changes.revision
    nodes = list(graph.nodes.values())
    endpoints: list[Publisher | Subscription] = [*graph.publishers.values(), *graph.subscriptions.values()]
    matches = [
        (one.id, [*one.matches], [*map(_STATE, one.matches.values())])
        for one in graph.publishers.values()
        if one.matches
    ]
    yield len(graph) // LOOKS_PER_UNIT
    if shown is not None:
        seen_nodes, seen = shown
        nodes = [node for node in nodes if node.id in seen_nodes]
        endpoints = [one for one in endpoints if one.id in seen]
        matches = [one for one in matches if one[0] in seen]
        yield len(graph) // LOOKS_PER_UNIT * 2
    records: Any = [ArrayEncoder(), ArrayEncoder(), ArrayEncoder()]
    for some in _pieces(nodes):
        records[0].extend([node.record() for node in some])
        yield RECORD * len(some)
    for few in _pieces(endpoints):
        records[1].extend([one.record(statistics=statistics) for one in few])
        looks = sum(len(one.matches) for one in few) if statistics else 0
        yield RECORD * len(few) + looks // LOOKS_PER_UNIT
    for pairs in _pieces(
        MatchRecord(publisher=one, subscription=other, route=ROUTE_OF[state])
        for one, others, states in matches
        for other, state in zip(others, states, strict=True)
        if shown is None or other in seen
    ):
        records[2].extend(pairs)
        yield RECORD * len(pairs)
    encoded = [one.raw() for one in records]
    yield sum(len(one) for one in encoded) >> 12
    return GraphSnapshot(
        request=request,
        revision=revision,
        nodes=encoded[0],
        endpoints=encoded[1],
        matches=encoded[2],
        pid=pid,
    )


def _pieces(items: Iterable[_T]) -> Iterator[list[_T]]:
    left = iter(items)
    while some := list(islice(left, _PIECE)):
        yield some

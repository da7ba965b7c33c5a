"""Invented views of a bus, for tests of `bus metrics` and `bus doctor`."""

from collections.abc import Iterable

from bus.base.version import RELEASE
from bus.graph import Graph, graph_of
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus_cli.metrics.view import View

PUBLISHER, SUBSCRIPTION = "publisher", "subscription"
HELLO = m.Hello(version=1, program="busd", lease_s=10.0, release=RELEASE)


def endpoint(  # noqa: PLR0913
    id: int,
    kind: str,
    topic: str = "/chatter",
    *,
    node: int = 1,
    gid: bytes = b"",
    samples: int = 0,
    size: int = 0,
    queued: int = 0,
    expected: int = 0,
    **dropped: int,
) -> m.EndpointRecord:
    """An endpoint of node `/n<node>` with its counters."""
    return m.EndpointRecord(
        id=id,
        kind=kind,
        node=node,
        topic=topic,
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_0",
        gid=gid or id.to_bytes(16, "big"),
        qos=QoSProfile(),
        statistics=m.EndpointStatistics(
            samples=samples, bytes=size, queued=queued, dropped=dropped, expected=expected
        ),
    )


def graph(*endpoints: m.EndpointRecord, matches: Iterable[m.MatchRecord] = ()) -> Graph:
    """A graph of these endpoints, with the nodes that they need."""
    nodes = sorted({one.node for one in endpoints})
    return graph_of(
        m.GraphSnapshot(
            request=1,
            revision=1,
            nodes=tuple(m.NodeRecord(id=id, name=f"n{id}", namespace="/", pid=1000 + id) for id in nodes),
            endpoints=endpoints,
            matches=tuple(matches),
        )
    )


def view(graph: Graph, charges: m.Peers | None = None) -> View:
    return View(HELLO, graph, charges, 0.001)

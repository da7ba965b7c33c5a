"""The graph for an AsyncNode, read without the event loop, which must not wait.

busd answers on a second, short connection. Endpoints of the node that busd does not know yet are added.
"""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from msgspec.structs import replace

from bus.graph import Graph, GraphEndpoint
from bus.link.query import Query
from bus.node import Node as NativeNode
from bus.node.node import link_of
from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.impl.async_entity import AsyncEntity, EntityState

__all__ = ["read_graph", "with_new"]

_ANSWER_S = 2.0
"""The longest time that the event loop waits for busd."""


def read_graph(native: NativeNode, entities: Iterable[AsyncEntity]) -> Graph:
    """The graph now. Raises RCLError before the node runs, BrokerUnavailable if busd does not answer."""
    link = link_of(native)
    if link is None:
        raise RCLError(f"node '{native.full_name}' does not run: the graph is not known before `run`")
    with Query(Path(link.path), may_start=False, answer_s=_ANSWER_S) as query:
        return with_new(query.graph(), native.full_name, entities)


def with_new(graph: Graph, node_name: str, entities: Iterable[AsyncEntity]) -> Graph:
    """`graph` and the endpoints of the node that are opening, in case busd did not know them yet."""
    node = next((one for one in graph.nodes if one.full_name == node_name), None)
    if node is None:
        return graph
    found = {"publisher": list(graph.publishers), "subscription": list(graph.subscriptions)}
    known = Counter(
        (kind, one.topic) for kind, ends in found.items() for one in ends if one.node.id == node.id
    )
    for entity in entities:
        if entity.state not in (EntityState.OPENING, EntityState.OPEN):
            continue
        for kind, topic, support, qos in entity.ends():
            known[kind, topic] -= 1
            if known[kind, topic] < 0:
                end = GraphEndpoint(0, kind, node, topic, support.name, support.hash, bytes(16), qos)
                found[kind].append(end)
    return replace(graph, publishers=tuple(found["publisher"]), subscriptions=tuple(found["subscription"]))

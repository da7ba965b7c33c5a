"""The origin of a node that a bridge mirrors, as text and as JSON."""

from typing import Any

from bus.graph import Graph, GraphNode, Origin

__all__ = ["origin_record", "origin_text", "origins"]


def origins(graph: Graph) -> dict[int, Origin]:
    """Origins of mirrored nodes, by node id. Leaves out bridges' own nodes: their origin is this bus."""
    found = {node.id: node.origin for node in graph.nodes if node.origin is not None}
    if found:
        from bus_bridge.core.status import SERVICE_TYPE

        for endpoint in graph.subscriptions:
            if endpoint.type_name.startswith(SERVICE_TYPE):  # only bridges have this service
                found.pop(endpoint.node.id, None)
    return found


def origin_text(origin: Origin) -> str:
    """A text such as `from laptop-1f2e3d4c by zenoh`; the first name is the bus of the node."""
    through = (*origin.via, origin.bus)[1:]
    way = f" through {', '.join(through)}" if through else ""
    return f"from {origin.home}{way} by {origin.bridge}"


def origin_record(node: GraphNode) -> dict[str, Any]:
    """Additional keys for the node's JSON record: its origin; empty for a node of this bus."""
    if node.origin is None:
        return {}
    from msgspec import to_builtins

    return {"origin": to_builtins(node.origin)}

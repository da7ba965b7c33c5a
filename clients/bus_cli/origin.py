"""Where a node comes from that a bridge has brought, as a text and as JSON."""

from typing import Any

from bus.graph import Graph, GraphNode, Origin

__all__ = ["origin_record", "origin_text", "origins"]


def origins(graph: Graph) -> dict[int, Origin]:
    """By the ids of nodes. A bridge's own node has one too, this bus, and is left out."""
    found = {node.id: node.origin for node in graph.nodes if node.origin is not None}
    if found:
        from bus_bridge.core.status import SERVICE_TYPE

        for endpoint in graph.subscriptions:
            if endpoint.type_name.startswith(SERVICE_TYPE):  # bridges are asked how they are
                found.pop(endpoint.node.id, None)
    return found


def origin_text(origin: Origin) -> str:
    """As `from laptop-1f2e3d4c by zenoh`; the bus on which the node lives comes first."""
    through = (*origin.via, origin.bus)[1:]
    way = f" through {', '.join(through)}" if through else ""
    return f"from {origin.home}{way} by {origin.bridge}"


def origin_record(node: GraphNode) -> dict[str, Any]:
    """What a record of the node has besides: nothing where it lives on this bus."""
    if node.origin is None:
        return {}
    from msgspec import to_builtins

    return {"origin": to_builtins(node.origin)}

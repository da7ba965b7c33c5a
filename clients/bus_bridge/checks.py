"""Checks of the descriptions of far buses, nodes and endpoints. Pure.

All data from a far bridge is hostile until this module has checked it: names, lengths, kinds.
"""

from bus.errors import ConfigurationError
from bus.names import validate_full_topic_name, validate_namespace, validate_node_name
from bus.qos import Durability
from bus.types.schema_form import is_type_name
from bus_bridge.engine import FarBus, FarEndpoint, FarNode

__all__ = ["wrong_bus", "wrong_endpoint", "wrong_node"]

_GID_BYTES = 16
_MAX_ID = 100
_MAX_HASH = 255
_MAX_VIA = 16


def wrong_bus(bus: FarBus) -> str:
    """The fault in the description of a bus, as text; "" if there is none."""
    return _wrong_id("the id of a bus", bus.id)


def wrong_node(node: FarNode) -> str:
    """The fault in the description of a node, as text; "" if there is none."""
    if len(node.via) > _MAX_VIA:
        return f"a node that came through {len(node.via)} buses; the limit is {_MAX_VIA}"
    for one in node.via:
        if wrong := _wrong_id("the id of a bus that a node came through", one):
            return wrong
    try:
        validate_namespace(node.namespace)
        validate_node_name(node.name)
    except ConfigurationError as error:
        return f"an invalid node name: {_first_line(error)}"
    return ""


def wrong_endpoint(endpoint: FarEndpoint) -> str:
    """The fault in the description of an endpoint, as text; "" if there is none."""
    if len(endpoint.gid) != _GID_BYTES:
        return f"a gid of {len(endpoint.gid)} bytes; it has {_GID_BYTES}"
    try:
        validate_full_topic_name(endpoint.topic)
    except ConfigurationError as error:
        return f"an invalid topic name: {_first_line(error)}"
    where = f"on '{endpoint.topic}'"
    if not is_type_name(endpoint.type_name):
        return f"a type {endpoint.type_name[:_MAX_ID]!r} {where}; its name has three parts"
    if len(endpoint.type_hash) > _MAX_HASH or not endpoint.type_hash.isprintable():
        return f"a type hash of {len(endpoint.type_hash)} characters {where}"
    if endpoint.kind == "publisher" and endpoint.qos.durability is Durability.BEST_AVAILABLE:
        return f"a publisher {where} with durability best_available, which is for subscriptions"
    return ""


def _wrong_id(what: str, text: str) -> str:
    if 0 < len(text) <= _MAX_ID and text.isprintable() and " " not in text:
        return ""
    return f"{what} that can't be one: {text[:_MAX_ID]!r}"


def _first_line(error: ConfigurationError) -> str:
    """The violated rule and the name, without the caret below it."""
    return " ".join(line.strip() for line in str(error).splitlines()[:2])

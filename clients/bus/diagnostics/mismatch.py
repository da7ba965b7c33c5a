"""For tools: the reason why a publisher and a subscription of one topic don't match, found in the graph.

busd itself sends such texts to the two endpoints: `incompatibility` in `busd.core.matching`.
"""

from collections.abc import Callable

from bus.graph import GraphEndpoint
from bus.qos import check_compatible, describe_incompatibilities

__all__ = ["Describe", "kept_apart", "mismatch"]

Describe = Callable[[str, str], bytes | None]
"""The encoded description of the type with that name and hash; None if no endpoint has it any more."""


def mismatch(publisher: GraphEndpoint, subscription: GraphEndpoint, describe: Describe) -> str | None:
    """The reason, or None if the endpoints can match. `describe` is called if two types have one name."""
    if kept_apart(publisher, subscription):
        return None  # busd doesn't report this either
    if publisher.type_name != subscription.type_name:
        return f"the publisher has {publisher.type_name}, the subscription {subscription.type_name}"
    if publisher.type_hash != subscription.type_hash:
        return f"both call it {publisher.type_name}, but {_difference(publisher, subscription, describe)}"
    return describe_incompatibilities(check_compatible(publisher.qos, subscription.qos)).rstrip(";") or None


def kept_apart(publisher: GraphEndpoint, subscription: GraphEndpoint) -> str:
    """The reason why mirrors of bridges don't match; "" if they may.

    Messages must not return to their source.
    """
    one, other = publisher.node.origin, subscription.node.origin
    shared = set() if one is None or other is None else one.buses & other.buses
    return f"both have come from {min(shared)}" if shared else ""


def _difference(publisher: GraphEndpoint, subscription: GraphEndpoint, describe: Describe) -> str:
    from bus.types.diff import difference

    ours, theirs = (describe(one.type_name, one.type_hash) for one in (publisher, subscription))
    found = None if ours is None or theirs is None else difference(ours, theirs)
    return found or "their definitions differ"

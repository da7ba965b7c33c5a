"""Why a publisher and a subscription of one topic are no match, in busd's words."""

from collections.abc import Callable

from bus.graph import GraphEndpoint
from bus.qos import check_compatible, describe_incompatibilities

__all__ = ["Describe", "kept_apart", "mismatch"]

Describe = Callable[[str, str], bytes | None]
"""The description of the type with that name and hash, as it travels; None where no endpoint has it any
more."""


def mismatch(publisher: GraphEndpoint, subscription: GraphEndpoint, describe: Describe) -> str | None:
    """None where nothing speaks against the match. `describe` is asked where two types have one name."""
    if kept_apart(publisher, subscription):
        return None  # busd says nothing of it either
    if publisher.type_name != subscription.type_name:
        return f"the publisher has {publisher.type_name}, the subscription {subscription.type_name}"
    if publisher.type_hash != subscription.type_hash:
        return f"both call it {publisher.type_name}, but {_difference(publisher, subscription, describe)}"
    return describe_incompatibilities(check_compatible(publisher.qos, subscription.qos)).rstrip(";") or None


def kept_apart(publisher: GraphEndpoint, subscription: GraphEndpoint) -> str:
    """Why what bridges have brought is not matched: else it would go back where it came from. "": it may
    be."""
    one, other = publisher.node.origin, subscription.node.origin
    shared = set() if one is None or other is None else one.buses & other.buses
    return f"both have come from {min(shared)}" if shared else ""


def _difference(publisher: GraphEndpoint, subscription: GraphEndpoint, describe: Describe) -> str:
    from bus.types.diff import difference

    ours, theirs = (describe(one.type_name, one.type_hash) for one in (publisher, subscription))
    found = None if ours is None or theirs is None else difference(ours, theirs)
    return found or "their definitions differ"

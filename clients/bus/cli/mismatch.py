"""Why a publisher and a subscription of one topic are no match, in the broker's words."""

from bus.graph import GraphEndpoint
from bus.qos import check_compatible, describe_incompatibilities


def mismatch(publisher: GraphEndpoint, subscription: GraphEndpoint) -> str | None:
    """None where nothing speaks against the match."""
    if publisher.type_name != subscription.type_name:
        return f"the publisher has {publisher.type_name}, the subscription {subscription.type_name}"
    if publisher.type_hash != subscription.type_hash:
        return f"both call it {publisher.type_name}, but their definitions differ"
    return describe_incompatibilities(check_compatible(publisher.qos, subscription.qos)).rstrip(";") or None

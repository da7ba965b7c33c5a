"""Rules that only apply to bridge mirrors and taps: origins, and which endpoints may match.

Must not know how matches are made. (Their state is BRIDGED of `busd.core.match`.)
"""

from bus.errors import RemoteProtocolError
from bus.wire.messages import Origin
from busd.core.entities import Publisher, Subscription

__all__ = ["are_for_each_other", "check_origin"]


def are_for_each_other(publisher: Publisher, subscription: Subscription) -> bool:
    """Whether there may be a match at all; if not, no process is told.

    Samples from a bridge never go back to a bus that they were on. A tap is for lossless publishers alone or
    for all others alone. So each publisher has one.
    """
    origin = publisher.node.origin
    if origin is not None:
        there = subscription.node.origin
        if subscription.local_only or (there is not None and origin.buses & there.buses):
            return False
    if subscription.is_tap:
        is_same_type = publisher.type == subscription.type
        return is_same_type and publisher.is_lossless is subscription.is_lossless
    return True


def check_origin(origin: Origin) -> None:
    """Raises RemoteProtocolError for an origin that can't be shown."""
    for text in (origin.bridge, origin.bus, *origin.via):
        if not text.isprintable():  # it is shown on terminals and in logs
            raise RemoteProtocolError(f"origin {text!r}, which can't be printed")

"""Why messages did not go on, as the bridge and its engines count them. docs/bridge.md explains each."""

from typing import Final

__all__ = [
    "DISCONNECTED",
    "EXPIRED",
    "LINK_FULL",
    "LOST",
    "MEMORY",
    "NOT_WANTED",
    "RATE",
    "REFUSED",
    "REPEATED",
    "REPLACED",
    "TOO_LARGE",
    "UNDECODABLE",
]

REPLACED: Final = "replaced"
"""The route's queue in the bridge was full: the oldest goes."""
MEMORY: Final = "memory_limit"
"""That queue had too many bytes."""
RATE: Final = "rate_limit"
"""A rule allows fewer messages in a second."""
NOT_WANTED: Final = "not_wanted"
"""No subscription on the other side is matched with the publisher."""
DISCONNECTED: Final = "disconnected"
"""Its publisher, or the way to the far side, went before it could go on."""
REPEATED: Final = "repeated"
"""It had come before."""
EXPIRED: Final = "expired"
"""It was older than its lifespan when it came."""
TOO_LARGE: Final = "too_large"
"""Larger than this bus allows."""
REFUSED: Final = "refused"
"""This bus or DDS did not take it."""
LINK_FULL: Final = "link_full"
"""Of a best effort publisher: messages come faster than the link to another bus takes them."""
UNDECODABLE: Final = "undecodable"
"""It is no message of its type, so DDS can't have it, or has sent it."""
LOST: Final = "lost_on_the_way"
"""Its number is missing in what came: it never was in this bridge, and counts as none of what was taken."""

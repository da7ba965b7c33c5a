"""Common words of the protocol, the statistics and the tools: routes, and reasons for lost messages.

Each word is defined only here. A program with another release may send other words. So the fields of the
protocol have type `str`, and are compared with these.
"""

from enum import StrEnum

__all__ = ["DropReason", "Route"]


class Route(StrEnum):
    """The way of the messages of one match. busd chooses it."""

    __repr__ = str.__repr__

    SHM = "shm"
    """A ring in shared memory: busd sees none of the messages."""
    SOCKET = "socket"
    """Through busd."""
    BRIDGE = "bridge"
    """Over a bridge: no message passes through busd."""


class DropReason(StrEnum):
    """The reason why a message was not delivered. Statistics count lost messages by these words."""

    __repr__ = str.__repr__  # users print dicts with these keys

    REPLACED = "replaced"
    """A queue with a depth was full, and a newer message took its place."""
    PUBLISHER_QUEUE = "publisher_queue"
    """It was replaced in the queue or the ring of its publisher."""
    EXPIRED = "expired"
    """It was older than its lifespan."""
    MEMORY_LIMIT = "memory_limit"
    """A queue had too many bytes."""
    TOO_LARGE = "too_large"
    """It was larger than busd allows."""
    UNDECODABLE = "undecodable"
    """Its bytes are no message of its type."""
    DISCONNECTED = "disconnected"
    """It was on its way when busd, its publisher or a bridge ended."""

    RECORDER_CACHE = "recorder_cache"
    """A recorder had no room for it: its disk is too slow."""
    NOT_WRITTEN = "not_written"
    """A recorder could not write it: its disk was full, or its recording was ended at once."""
    UNEXPLAINED = "unexplained"
    """It is missing in a recording, and no counter has the reason."""

    RATE_LIMIT = "rate_limit"
    """A rule of a bridge allows fewer messages a second."""
    NOT_WANTED = "not_wanted"
    """A bridge found no matched subscription on the other side."""
    REPEATED = "repeated"
    """It had come over a bridge before."""
    REFUSED = "refused"
    """This bus, or DDS, did not take it from a bridge."""
    LINK_FULL = "link_full"
    """Messages of a best-effort publisher came faster than the link between two buses accepts them."""
    LOST_ON_THE_WAY = "lost_on_the_way"
    """Its number is missing among the messages that a bridge received: the bridge never had it."""

"""QoS policies of DDS, for readers and writers, and the rule for compatible ones. Pure.

Must not know: how policies travel, and the profiles of this bus.
"""

from typing import Final, NamedTuple

from bus_bridge.rtps.parameters import FOREVER_NS

__all__ = [
    "AUTOMATIC",
    "MANUAL_BY_TOPIC",
    "RELIABLE",
    "TRANSIENT_LOCAL",
    "VOLATILE",
    "Policies",
    "is_compatible",
]

VOLATILE, TRANSIENT_LOCAL = 0, 1
"""Kinds of durability; higher ones are not offered here."""
AUTOMATIC, MANUAL_BY_TOPIC = 0, 2
"""Kinds of liveliness; 1 is manual by participant."""


class Policies(NamedTuple):
    """QoS of one reader or writer; durations are in nanoseconds."""

    reliable: bool = True
    durability: int = VOLATILE
    keep_all: bool = False
    depth: int = 1
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    """Only for writers; readers have none."""
    liveliness: int = AUTOMATIC
    lease_ns: int = FOREVER_NS

    @property
    def transient_local(self) -> bool:
        return self.durability >= TRANSIENT_LOCAL

    @property
    def manual(self) -> bool:
        return self.liveliness == MANUAL_BY_TOPIC


RELIABLE: Final = Policies()
"""Reliable, volatile."""


def is_compatible(offered: Policies, requested: Policies) -> bool:
    """Whether a writer offers at least as much as a reader requests."""
    return (
        offered.reliable >= requested.reliable
        and offered.durability >= requested.durability
        and offered.deadline_ns <= requested.deadline_ns
        and offered.liveliness >= requested.liveliness
        and offered.lease_ns <= requested.lease_ns
    )

"""QoS policies of DDS, for readers and writers, and the rule for compatible ones. Pure.

Must not know: how policies travel, and the profiles of this bus.
"""

from typing import Final, NamedTuple

from bus_bridge.rtps.parameters import FOREVER_NS

__all__ = ["MANUAL_BY_TOPIC", "RELIABLE", "TRANSIENT_LOCAL", "Policies", "is_compatible"]

TRANSIENT_LOCAL: Final = 1
MANUAL_BY_TOPIC: Final = 2


class Policies(NamedTuple):
    """QoS of one reader or writer; durations are in nanoseconds."""

    reliable: bool = True
    durability: int = 0
    """0: volatile, 1: transient local; higher ones are not offered here."""
    keep_all: bool = False
    depth: int = 1
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    """Only for writers; readers have none."""
    liveliness: int = 0
    """0: automatic, 1: manual by participant, 2: manual by topic."""
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

"""Names for the plain ints that identify and order things, so that one can't be passed for another.

Must not know what they are used for. The three ids are u32 on the wire.
"""

from typing import NewType

__all__ = ["EndpointId", "Nanoseconds", "NodeId", "PeerId", "Seq"]

PeerId = NewType("PeerId", int)
NodeId = NewType("NodeId", int)
EndpointId = NewType("EndpointId", int)

Seq = NewType("Seq", int)
"""Place of a sample among all that its publisher published."""

Nanoseconds = NewType("Nanoseconds", int)
"""A point on a clock, or a span of time, in nanoseconds."""

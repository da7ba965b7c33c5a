"""Names for the plain ints that identify things, so that one can't be passed for another.

Must not know what they are used for. They are u32 on the wire.
"""

from typing import NewType

__all__ = ["EndpointId", "NodeId", "PeerId"]

PeerId = NewType("PeerId", int)
NodeId = NewType("NodeId", int)
EndpointId = NewType("EndpointId", int)

"""Types for the ints that identify objects. They make a wrong kind of id a type error.

Must not know the use of ids. They are u32 on the wire.
"""

from typing import NewType

__all__ = ["EndpointId", "NodeId", "PeerId"]

PeerId = NewType("PeerId", int)
NodeId = NewType("NodeId", int)
EndpointId = NewType("EndpointId", int)

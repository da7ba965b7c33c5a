"""What a bridge tells of itself, as a service: its links, its routes and what became of each message.

`bus bridge status` finds bridges by the type of this service. Values only; the bridge answers.
"""

from typing import Annotated, ClassVar

import msgspec
from msgspec import Meta

from bus.srv import Service

__all__ = ["SERVICE_TYPE", "GetStatus", "LinkState", "MirrorCounts", "RouteState"]

SERVICE_TYPE = "bus_bridge/srv/GetStatus"

_Count = Annotated[int, Meta(ge=0)]


class LinkState(msgspec.Struct, kw_only=True):
    """One link, or one address that the bridge tries to reach."""

    __type_name__: ClassVar[str] = "bus_bridge/msg/LinkState"

    address: str = ""
    state: str = "trying"
    """`up`, `trying`, `refused`, or `spare`: another address is used in its place."""
    bus: str = ""
    """The id of the far bus, if it is known."""
    text: str = ""
    """Why it is not up."""


class MirrorCounts(msgspec.Struct, kw_only=True):
    """How many nodes and endpoints one side shows of the other."""

    __type_name__: ClassVar[str] = "bus_bridge/msg/MirrorCounts"

    nodes: _Count = 0
    publishers: _Count = 0
    subscriptions: _Count = 0


class RouteState(msgspec.Struct, kw_only=True):
    """The way of one publisher's messages. `taken` is the sum of `sent`, `waiting` and all of `dropped`."""

    __type_name__: ClassVar[str] = "bus_bridge/msg/RouteState"

    topic: str = ""
    """As it is called on this bus."""
    type_name: str = ""
    direction: str = "out"
    """`out`: from this bus; `in`: to this bus."""
    node: str = ""
    """Full name of the publisher's node."""
    bus: str = ""
    """For routes into this bus: the bus that the messages come from."""
    gid: str = ""
    """The publisher's, in hex."""
    is_flowing: bool = False
    """Whether a subscription on the other side wants its messages."""
    is_stuck: bool = False
    """Whether the route is wanted, messages wait, and none has left for some seconds."""
    taken: _Count = 0
    sent: _Count = 0
    bytes: _Count = 0
    """Bytes of payload in sent messages."""
    waiting: _Count = 0
    counts_lost: bool = True
    """Whether `lost_on_the_way` can be counted. Messages of DDS have no numbers that a bridge could read."""
    dropped: dict[str, int] = {}
    """By reason. For routes into this bus, `lost_on_the_way` is not part of `taken`: those messages never
    came."""


class GetStatus(Service):
    """Asks a bridge how it is."""

    __type_name__ = SERVICE_TYPE

    class Request(msgspec.Struct, kw_only=True):
        pass

    class Response(msgspec.Struct, kw_only=True):
        engine: str = ""
        """`zenoh` or `ros2`."""
        bus: str = ""
        """The id of this bus."""
        namespace: str = "/"
        uptime_s: float = 0.0
        links: list[LinkState] = []
        buses: list[str] = []
        """Ids of the far buses that are there now."""
        shown_here: MirrorCounts = msgspec.field(default_factory=MirrorCounts)
        """Far nodes and endpoints that are mirrored on this bus."""
        shown_there: MirrorCounts = msgspec.field(default_factory=MirrorCounts)
        """Nodes and endpoints of this bus that far sides can see."""
        refused: _Count = 0
        """Connections that were refused before it was known which bus asks, by TLS say."""
        refusal: str = ""
        """Why the last of them was."""
        repeated: _Count = 0
        """Messages that came a second time, and were dropped."""
        routes: list[RouteState] = []

"""The status of a bridge as a service: its links, its routes and the counters of messages.

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
    """`up`, `trying`, `refused`, or `spare`: another address is used instead."""
    bus: str = ""
    """The id of the far bus, if it is known."""
    text: str = ""
    """The reason why it is not up."""


class MirrorCounts(msgspec.Struct, kw_only=True):
    """Numbers of nodes and endpoints that one side shows of the other."""

    __type_name__: ClassVar[str] = "bus_bridge/msg/MirrorCounts"

    nodes: _Count = 0
    publishers: _Count = 0
    subscriptions: _Count = 0


class RouteState(msgspec.Struct, kw_only=True):
    """The route of one publisher's messages. `taken` is the sum of `sent`, `waiting` and all of `dropped`."""

    __type_name__: ClassVar[str] = "bus_bridge/msg/RouteState"

    topic: str = ""
    """The name of the topic on this bus."""
    type_name: str = ""
    direction: str = "out"
    """`out`: from this bus; `in`: to this bus."""
    node: str = ""
    """Full name of the publisher's node."""
    bus: str = ""
    """For routes into this bus: the source bus of the messages."""
    gid: str = ""
    """The publisher's gid, in hex."""
    is_flowing: bool = False
    """Whether a subscription on the other side wants its messages."""
    is_stuck: bool = False
    """Whether a subscription wants messages and some wait, but none has left for some seconds."""
    taken: _Count = 0
    sent: _Count = 0
    bytes: _Count = 0
    """Bytes of payload in sent messages."""
    waiting: _Count = 0
    counts_lost: bool = True
    """Whether `lost_on_the_way` can be counted. Messages of DDS have no numbers that a bridge could read."""
    dropped: dict[str, int] = {}
    """Dropped messages by reason.

    For routes into this bus, `lost_on_the_way` is not part of `taken`, because those messages never arrived.
    """


class GetStatus(Service):
    """Asks a bridge for its status."""

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
        """Ids of the present far buses."""
        shown_here: MirrorCounts = msgspec.field(default_factory=MirrorCounts)
        """Far nodes and endpoints that are mirrored on this bus."""
        shown_there: MirrorCounts = msgspec.field(default_factory=MirrorCounts)
        """Nodes and endpoints of this bus that far sides can see."""
        refused: _Count = 0
        """Connections that were refused before the bridge knew the other bus, for example by TLS."""
        refusal: str = ""
        """The reason of the last refusal."""
        repeated: _Count = 0
        """Messages that arrived a second time, and were dropped."""
        routes: list[RouteState] = []

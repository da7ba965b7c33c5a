"""What a graph is made of, as it stands inside the messages Graph and GraphChanged.

Owns the records of nodes, endpoints and matches; must not know the messages that carry them.
"""

import msgspec

from bus.qos import QoSProfile


class NodeRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    id: int
    name: str
    namespace: str
    pid: int


class EndpointStatistics(msgspec.Struct, frozen=True, omit_defaults=True):
    """Live counters of an endpoint.

    Of a publisher: samples and bytes published. Of a subscription: samples and bytes delivered, samples
    waiting (in the broker and in the process), and samples dropped by reason.
    """

    samples: int = 0
    bytes: int = 0
    queued: int = 0
    dropped: dict[str, int] = {}


class EndpointRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    id: int
    kind: str
    node: int
    topic: str
    type_name: str
    type_hash: str
    gid: bytes
    qos: QoSProfile
    statistics: EndpointStatistics | None = None


class MatchRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    publisher: int
    subscription: int
    route: str = "socket"

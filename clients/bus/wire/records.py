"""The records in the messages GraphSnapshot, GraphChanged and Peers.

Owns the records of nodes, endpoints and matches, and of the resources of busd that processes and users use.
Must not know the messages that carry them.
"""

import msgspec

from bus.qos import QoSProfile
from bus.vocabulary import Route
from bus.wire.bounds import Buses, BusId


class Origin(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """The origin of a node that a bridge mirrors here: it is on another bus.

    For example:

        print([one.origin.bus for one in (await node.graph()).nodes if one.origin is not None])
    """

    bridge: BusId
    """The kind of bridge that mirrors it, such as `zenoh`."""
    bus: BusId
    """The id of the last bus before this one."""
    via: Buses = ()
    """The buses before `bus`, its own bus first; empty if `bus` is its own."""

    @property
    def home(self) -> str:
        """The node's own bus."""
        return self.via[0] if self.via else self.bus

    @property
    def buses(self) -> frozenset[str]:
        """All buses that it was on before this one."""
        return frozenset((self.bus, *self.via))


class NodeRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    id: int
    name: str
    namespace: str
    pid: int
    origin: Origin | None = None


class EndpointStatistics(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """Live counters of an endpoint.

    A publisher's counters are samples and bytes published. A subscription has more:

    - samples and bytes delivered
    - samples waiting, in busd and in the process
    - samples dropped, by reason
    - samples expected: published to it since its matches began; while no message is on its way, samples +
      queued + dropped

        graph = await node.graph(statistics=True)
        print([one.statistics.samples for one in graph.publishers])
    """

    samples: int = 0
    """Messages published, or delivered."""
    bytes: int = 0
    """Their encoded size."""
    queued: int = 0
    """Messages that wait."""
    dropped: dict[str, int] = {}
    """Messages lost, by reason."""
    expected: int = 0
    """Messages published to a subscription since its matches began."""
    at_ns: int = 0
    """Time at which `samples` and `bytes` were counted, to compute a rate. In nanoseconds of the monotonic
    clock, which all processes of the machine share (`time.monotonic_ns`); 0 if its process has not reported
    it."""
    age_count: int = 0
    """Messages with a measured age (the time from publishing to taking by a subscription), in the half second
    up to `at_ns`. If there are few messages, all are measured."""
    age_sum_ns: int = 0
    """The sum of these ages, in nanoseconds."""
    age_max_ns: int = 0
    """The highest of them."""
    most_missed: int = 0
    """The most messages that the depth of a subscription replaced between two taken ones: with a depth higher
    by this number it would have lost none of them."""
    age_parts: tuple[int, ...] = ()
    """The same ages as a histogram: the number in each part, up to the last part used. Part 0 is of ages
    below 1.024 µs. The parts 2n - 1 and 2n begin at 512 ns and 768 ns, multiplied by 2 to the power of n."""


class EndpointRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    id: int
    kind: str
    node: int
    topic: str
    type_name: str
    type_hash: str
    gid: bytes
    qos: QoSProfile
    statistics: EndpointStatistics | None = None


class MatchRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    publisher: int
    subscription: int
    route: str = Route.SOCKET


class PeerRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """The resources of busd that one process uses.

    `queued_bytes`: samples waiting for it; `history_bytes`: samples kept for its publishers; `control_bytes`:
    control frames waiting for it. `topics`: the topics of its endpoints. `refused`: number of refusals
    because of a limit. `silent_s`: seconds since its last frame.
    """

    id: int
    pid: int
    uid: int
    program: str = ""
    version: str = ""
    nodes: int = 0
    endpoints: int = 0
    topics: int = 0
    matches: int = 0
    descriptors: int = 0
    queued_bytes: int = 0
    history_bytes: int = 0
    control_bytes: int = 0
    refused: int = 0
    silent_s: float = 0.0


class UserRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """The resources of busd that all processes of one user use; `refused` includes departed processes.

    `absent`: subscriptions of lost processes, for which busd keeps missed messages.
    """

    uid: int
    connections: int = 0
    endpoints: int = 0
    topics: int = 0
    descriptors: int = 0
    queued_bytes: int = 0
    history_bytes: int = 0
    refused: int = 0
    absent: int = 0


class AbsentRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """Subscriptions of lost processes, for which busd keeps missed messages.

    `unclaimed`: all messages that waited for subscriptions that did not come back. `given_up`: subscriptions
    for which there was no room.
    """

    subscriptions: int = 0
    unclaimed: int = 0
    given_up: int = 0


class RoutingRecord(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """The time of runs in busd: from the read from a publisher's socket until they were passed on.

    A histogram of reads: `counts[i]` reads took at most `bounds_us[i]` microseconds, and more than the bound
    before; the last count is of reads above all bounds. `total_us` is the sum of all times. `runs`, `samples`
    and `bytes` count the traffic.
    """

    runs: int = 0
    samples: int = 0
    bytes: int = 0
    bounds_us: tuple[int, ...] = ()
    counts: tuple[int, ...] = ()
    total_us: int = 0

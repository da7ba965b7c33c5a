"""The roles of actors, and their reports: values only."""

import zlib

import msgspec

import bus


class Parcel(msgspec.Struct):
    """One message: a piece of random bytes with its checksum. A talker's numbers begin at 1."""

    talker: int
    number: int
    checksum: int
    body: bytes


def checksum(talker: int, number: int, body: bytes) -> int:
    return zlib.crc32(body, talker << 20 ^ number & 0xFFFFF)


class Quality(msgspec.Struct, frozen=True):
    """The QoS of an endpoint; depth 0 is keep all."""

    depth: int = 0
    is_reliable: bool = True
    is_durable: bool = False
    lifespan_s: float | None = None

    @property
    def is_lossless(self) -> bool:
        return self.is_reliable and not self.depth

    def serves(self, request: "Quality") -> bool:
        """Whether a publisher with this quality matches a subscription with `request`."""
        return self.is_reliable >= request.is_reliable and self.is_durable >= request.is_durable

    def profile(self) -> bus.QoSProfile:
        return bus.QoSProfile(
            self.depth or 10,
            history="keep_last" if self.depth else "keep_all",
            reliability="reliable" if self.is_reliable else "best_effort",
            durability="transient_local" if self.is_durable else "volatile",
            lifespan=self.lifespan_s,
        )


class Talker(msgspec.Struct, frozen=True, tag="talker"):
    """A publisher. `number` identifies it in its messages, and is never used again."""

    number: int
    topic: str
    quality: Quality
    sizes: tuple[int, int]
    burst: int
    pause_s: float


class Ear(msgspec.Struct, frozen=True, tag="ear"):
    """A subscription."""

    number: int
    topic: str
    quality: Quality
    calls_back: bool = True
    has_views: bool = False


class Role(msgspec.Struct, frozen=True):
    """A process with one node. Limits are additional to its resources at its start; 0 = no limit.

    `cgroup_bytes`: the limit for memory of any kind, in a cgroup of the kernel, which is `cgroup` once it is
    made.
    """

    name: str
    endpoints: tuple[Talker | Ear, ...]
    by_socket: bool = False
    is_fragile: bool = False  # its connection goes through a proxy, which cuts it
    loop: str = "uvloop"
    files: int = 0
    memory_bytes: int = 0
    cgroup_bytes: int = 0
    cgroup: str = ""
    seed: int = 0

    @property
    def is_limited(self) -> bool:
        return bool(self.files or self.memory_bytes or self.cgroup_bytes)


class Heard(msgspec.Struct):
    """For one talker: the number of messages, the first and last number, and how many are missing between."""

    messages: int = 0
    first: int = 0
    last: int = 0
    missing: int = 0


class EarLook(msgspec.Struct):
    """The state of a subscription: its own statistics, and its messages."""

    delivered: int
    queued: int
    dropped: dict[str, int]
    expected: int
    heard: dict[int, Heard]


class Look(msgspec.Struct):
    """The state of an actor; `talkers`: how many messages each has published."""

    talkers: dict[int, int]
    ears: dict[int, EarLook]
    losses: int = 0  # how often busd was lost
    cuts: int = 0
    errors: dict[str, int] = {}  # failures that are possible in a limited process

"""The task of a hostile program: a value that the measurement and the program share."""

from typing import Literal

import msgspec

Kind = Literal[
    "busy loop",
    "socket",
    "shared memory",
    "runs",
    "acks",
    "reports",
    "signs of life",
    "attaches",
    "pings",
    "questions",
    "observers",
    "endpoints",
    "types",
    "matches",
    "incompatible",
    "flapping",
    "replays",
    "rings",
    "connections",
    "garbage",
    "slow reader",
    "everything",
]


class Attack(msgspec.Struct, frozen=True):
    """One kind of attack, at full speed. The functions of this package describe the kinds.

    `connections`: number of connections. `samples`: number in a run, of `size` bytes each. `number`: of
    endpoints, types or pairs, if the kind has them. `uid`: run as that user, which only root can do; 0: as
    the current user.
    """

    kind: Kind
    connections: int = 1
    samples: int = 64
    size: int = 64
    number: int = 0
    uid: int = 0

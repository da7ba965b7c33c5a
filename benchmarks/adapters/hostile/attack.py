"""What a hostile program is told to do: a value, which the measurement and the program share."""

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
    """One thing, as fast as it goes; the modules of this package say what each kind is.

    `connections`: over so many. `samples` in a run, of `size` bytes each. `number`: of endpoints, types or
    pairs, where the kind has some. `uid`: as that user, which only root can be; 0: as whoever we are.
    """

    kind: Kind
    connections: int = 1
    samples: int = 64
    size: int = 64
    number: int = 0
    uid: int = 0

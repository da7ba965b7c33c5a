"""The steady load: its streams, its processes, and the text of a message. Pure; knows no bus.

Every talker publishes each stream, and every listener hears all of it; visitors come for the latched one,
stay until they have what they came for, and go. A process whose name begins with `socket` shares no memory.
"""

from typing import Literal, NamedTuple

import msgspec

from benchmarks.work import text_of

TALKERS = ("shm_talker_1", "shm_talker_2", "socket_talker")
LISTENERS = ("shm_listener", "socket_listener")
VISITORS = ("shm_visitor", "socket_visitor")
NAP_S = 0.1
"""How often a sleepy subscription takes what it still has of a lossy stream."""
VISIT_S = 1.0
"""From the beginning of a visit to that of the next one, at least."""

_HEAD = 64


class Stream(NamedTuple):
    """`rate` messages of `size` bytes a second from each talker.

    `kind`: lossless (reliable, keep all), lossy (best effort, keeps `depth`), or latched (transient local,
    keeps `depth` for late joiners).
    """

    topic: str
    size: int
    rate: float
    kind: Literal["lossless", "lossy", "latched"]
    depth: int = 0


STREAMS = (
    Stream("soak_small", 100, 200.0, "lossless"),
    Stream("soak_medium", 16 << 10, 20.0, "lossless"),
    Stream("soak_large", 1 << 20, 2.0, "lossless"),
    Stream("soak_lossy", 256, 200.0, "lossy", 100),
    Stream("soak_latched", 100, 10.0, "latched", 20),
)
LATCHED = next(stream for stream in STREAMS if stream.kind == "latched")
NAP_DEPTH = 10
"""Of a sleepy subscription, which so loses most of what comes while it sleeps."""


class Head(NamedTuple):
    """What a message says of itself: whose `number`-th it is on its topic, and when it was sent."""

    talker: str
    number: int
    sent_ns: int


class Part(msgspec.Struct, frozen=True):
    """What one process is to do: its name says what it is."""

    name: str


def text(talker: str, number: int, sent_ns: int, size: int) -> str:
    """The message."""
    return f"{talker} {number} {sent_ns}".ljust(_HEAD) + text_of(size)[_HEAD:]


def head_of(message: str, stream: Stream) -> Head | None:
    """What `message` says of itself; None where it is not what was sent on `stream`."""
    if len(message) != stream.size or not message.endswith(_TAILS[stream.size], _HEAD):
        return None
    talker, number, sent_ns = message[:_HEAD].split()
    return Head(talker, int(number), int(sent_ns))


def route_of(talker: str, listener: str) -> str:
    """shm or socket, where memory can be shared at all."""
    return "shm" if talker.startswith("shm") and listener.startswith("shm") else "socket"


_TAILS = {stream.size: text_of(stream.size)[_HEAD:] for stream in STREAMS}

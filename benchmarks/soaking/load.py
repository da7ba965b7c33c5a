"""The steady load: its streams, its processes, and the text of a message. Pure; knows no bus.

Every talker publishes each stream, and every listener subscribes to all of them. Visitors come for the
latched stream, stay until they have its messages, and go. A process shares no memory if its name begins with
`socket`.
"""

from typing import Literal, NamedTuple

import msgspec

from benchmarks.work import text_of

TALKERS = ("shm_talker_1", "shm_talker_2", "socket_talker")
LISTENERS = ("shm_listener", "socket_listener")
VISITORS = ("shm_visitor", "socket_visitor")
NAP_S = 0.1
"""Period in which a sleepy subscription takes the remaining messages of a lossy stream."""
VISIT_S = 1.0
"""Least time from the start of a visit to the start of the next one."""

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
"""Depth of a sleepy subscription. It loses most of the messages that arrive while it sleeps."""


class Head(NamedTuple):
    """The beginning of a message: its talker, its `number` on the topic, and its sending time."""

    talker: str
    number: int
    sent_ns: int


class Part(msgspec.Struct, frozen=True):
    """The task of one process; its name determines its kind."""

    name: str


def text(talker: str, number: int, sent_ns: int, size: int) -> str:
    """The text of a message."""
    return f"{talker} {number} {sent_ns}".ljust(_HEAD) + text_of(size)[_HEAD:]


def head_of(message: str, stream: Stream) -> Head | None:
    """The head of `message`; None if it was not sent on `stream`."""
    if len(message) != stream.size or not message.endswith(_TAILS[stream.size], _HEAD):
        return None
    talker, number, sent_ns = message[:_HEAD].split()
    return Head(talker, int(number), int(sent_ns))


def route_of(talker: str, listener: str) -> str:
    """The route between two processes: shm or socket; always socket if this machine can't share memory."""
    return "shm" if talker.startswith("shm") and listener.startswith("shm") else "socket"


_TAILS = {stream.size: text_of(stream.size)[_HEAD:] for stream in STREAMS}

"""What a worker is to do, and the words between it and the verb: lines of JSON both ways.

    verb    -> worker   Go: publish so many messages, or for so long. Stop: that is enough. Settle: so many
                        were published; wait until each has come or is known to be lost.
    worker  -> verb     Ready: it is matched with all. Sent: all were published. Progress: some were. Settled:
                        what came since the last time. Trouble: it can't go on; the text is for the user.

Owns their fields. Must not know processes or nodes.
"""

from typing import TypeAlias

import msgspec

from bus.qos import QoSProfile

__all__ = ["Event", "Go", "Progress", "Ready", "Sent", "Settle", "Settled", "Stop", "Task", "Trouble", "Word"]


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """One publisher or subscriber of one measurement.

    `rate` messages a second on a fixed schedule; 0: as fast as it goes.
    """

    role: str
    socket: str
    topic: str
    type_name: str
    size: int
    rate: float
    publishers: int
    subscribers: int
    qos: QoSProfile


class Go(msgspec.Struct, frozen=True, tag=True):
    """`count` messages, else as many as it can in `seconds`."""

    count: int
    seconds: float


class Stop(msgspec.Struct, frozen=True, tag=True):
    """No more messages."""


class Settle(msgspec.Struct, frozen=True, tag=True):
    """`published` by all publishers, since the beginning."""

    published: int


class Ready(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """`routes` of the matches of a publisher; `why_socket` says why they can't be by shared memory."""

    routes: tuple[str, ...] = ()
    why_socket: str = ""


class Progress(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """`count` messages of this Go were published so far."""

    count: int


class Sent(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """All of this Go, between two times of CLOCK_MONOTONIC."""

    count: int
    begin_ns: int
    end_ns: int


class Settled(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """What came since the last Settled, and of each stamped message when it was sent, how late that was, and
    how old it was when it came. `last_ns` is when the last one came (0: none did)."""

    delivered: int
    dropped: dict[str, int]
    last_ns: int
    sent_ns: list[int]
    late_ns: list[int]
    age_ns: list[int]


class Trouble(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """`text` is for the user."""

    text: str


Word: TypeAlias = Go | Stop | Settle
Event: TypeAlias = Ready | Progress | Sent | Settled | Trouble

"""The task of a worker, and the words between worker and verb: lines of JSON in both directions.

    verb    -> worker   Go: publish a number of messages, or for some time. Stop: publish no more.
                        Settle: wait until each published message has arrived or is known to be lost.
    worker  -> verb     Ready: matched with all. Sent: all are published. Progress: number published so far.
                        Settled: arrivals since the last Settled. Trouble: it can't continue, and why.

Owns the fields of the words. Must not know processes or nodes.
"""

from typing import TypeAlias

import msgspec

from bus.qos import QoSProfile

__all__ = ["Event", "Go", "Progress", "Ready", "Sent", "Settle", "Settled", "Stop", "Task", "Trouble", "Word"]


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """Task of one publisher or subscriber of one measurement.

    `rate`: messages a second on a fixed schedule; 0: at full speed.
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
    """Publish `count` messages; if that is 0, as many as possible in `seconds`."""

    count: int
    seconds: float


class Stop(msgspec.Struct, frozen=True, tag=True):
    """Publish no more messages."""


class Settle(msgspec.Struct, frozen=True, tag=True):
    """Wait for all messages. `published`: number of messages of all publishers since the beginning."""

    published: int


class Ready(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """`routes` of a publisher's matches; `why_socket` is the reason if they can't use shared memory."""

    routes: tuple[str, ...] = ()
    why_socket: str = ""


class Progress(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """The publisher has published `count` messages of this Go so far."""

    count: int


class Sent(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """The publisher has published all messages of this Go, between two times of CLOCK_MONOTONIC."""

    count: int
    begin_ns: int
    end_ns: int


class Settled(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """Arrivals since the last Settled. For each stamped message: its sending time, the delay of the sending
    after the due time, and its age at the arrival. `last_ns` is the arrival of the last message (0: none)."""

    delivered: int
    dropped: dict[str, int]
    last_ns: int
    sent_ns: list[int]
    late_ns: list[int]
    age_ns: list[int]


class Trouble(msgspec.Struct, frozen=True, tag=True, tag_field="event"):
    """The worker can't continue; `text` is for the user."""

    text: str


Word: TypeAlias = Go | Stop | Settle
Event: TypeAlias = Ready | Progress | Sent | Settled | Trouble

"""The work of a publisher and a subscriber, the same for every system: messages, their size, their rate.

Owns the payload's text and the pace. Must not know any system.
"""

import asyncio
import sys
from collections.abc import Callable, Iterable
from ctypes import memmove
from inspect import isawaitable
from time import monotonic_ns, sleep
from typing import Any

import msgspec

TOPIC = "bench"
HEAD = 64
"""Number of characters with stamps at the beginning of a paced message."""
AT_ONCE = "at once"
"""The way (`Work.publish_by`) to send one stamped message as soon as it reaches a subscriber."""
IMAGE = "image"
"""The way to publish like a camera, by rclpy: sensor_msgs/Image, with the profile for sensor data."""
_LOOP_NS = 2_000_000
_FILLING = "The quick brown fox jumps over the lazy dog. "
_BODY_AT = {kind: sys.getsizeof(kind()) - 1 for kind in (str, bytes)}
"""Offset of the characters in CPython's ASCII `str` and in `bytes`, computed without the final NUL."""


class Work(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement. Messages are a `str` of `size` ASCII characters at both ends, or `bytes`.

    - `rate`: messages a second; 0: at full speed without loss.
    - `warm_up`: number of messages before the measured ones.
    - `publish_by`, `take_by`: choose between ways to use a system.
    - `busy_poll_s`: time after each message for which the subscriber polls without sleeping, if it can.
    - `gives_turns`: the publisher is a program of asyncio; its loop gets a turn after each paced message.
    - `subscribers`: number of processes that get every message.
    - `depth`: for small paced messages, the number of messages by which a process may be late without a loss.
    - `topic`: for measurements of several pairs on one bus.
    - `prefill`: number of messages before the publisher is ready, to grow everything that grows with them.
      After them, the subscriber says `warm`.
    """

    size: int
    count: int
    warm_up: int
    rate: float = 0.0
    publish_by: str = ""
    take_by: str = ""
    busy_poll_s: float = 0.0
    gives_turns: bool = True
    subscribers: int = 1
    depth: int = 1000
    topic: str = TOPIC
    prefill: int = 0

    @property
    def total(self) -> int:
        """Number of all messages."""
        return self.warm_up + self.count


class Arrivals(msgspec.Struct, frozen=True):
    """Times of each message in ns: its delay after the schedule when it was sent, and its age at the
    arrival."""

    late_ns: list[int]
    age_ns: list[int]


def text_of(size: int) -> str:
    """`size` characters of one byte each."""
    return (_FILLING * (size // len(_FILLING) + 1))[:size]


class Stamped:
    """A paced message of `size` characters, complete except for the time of sending.

    The text is made before the clock is read, because making 1 MiB of text is not part of a message's way.
    The stamp is then written into it in place. This is safe only because nothing else refers to the text yet.
    """

    def __init__(self, size: int, due_ns: int, kind: type[str] | type[bytes] = str) -> None:
        head = f"{due_ns} "
        self._message: str | bytes = head.ljust(size) if kind is str else head.encode().ljust(size)
        self._at = id(self._message) + _BODY_AT[kind] + len(head)

    def now(self) -> Any:
        """The message, stamped now."""
        stamp = b"%d" % monotonic_ns()
        memmove(self._at, stamp, len(stamp))
        return self._message


async def pace(send: Callable[[Any], object], work: Work, kind: type[str] | type[bytes] = str) -> None:
    """`send` warm-up and messages by a fixed schedule.

    A late publisher sends overdue messages at once, and skips none (no coordinated omission): each message
    begins with its due time and its sending time. After each message the event loop gets a turn, if
    `work.gives_turns`. The process sleeps itself, because the timers of uvloop have whole milliseconds.
    """
    period_ns = 1e9 / work.rate
    start_ns = monotonic_ns() + period_ns
    for number in range(work.total):
        due_ns = int(start_ns + number * period_ns)
        message = Stamped(work.size, due_ns, kind)
        if work.gives_turns and due_ns - monotonic_ns() > 2 * _LOOP_NS:
            # There is much time: the loop gets it, and may need it to send large messages.
            await asyncio.sleep((due_ns - monotonic_ns() - _LOOP_NS) / 1e9)
        rest_ns = due_ns - monotonic_ns()
        if rest_ns > 0:
            sleep(rest_ns / 1e9)  # noqa: ASYNC251
        sent = send(message.now())
        if isawaitable(sent):
            await sent
        if work.gives_turns:
            await asyncio.sleep(0)


def arrivals(heads: Iterable[str | bytes], arrived_ns: Iterable[int], work: Work) -> Arrivals:
    """The times from the stamps in `heads`. The first `warm_up` messages don't count."""
    late, age = [], []
    for head, now_ns in zip(heads, arrived_ns, strict=True):
        due_ns, sent_ns = map(int, head.split())
        late.append(sent_ns - due_ns)
        age.append(now_ns - sent_ns)
    return Arrivals(late_ns=late[work.warm_up :], age_ns=age[work.warm_up :])

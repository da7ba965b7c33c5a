"""What a publisher and a subscriber are to do, the same for every system: messages, their size, their rate.

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
"""Characters at the beginning of a paced message, in which its stamps stand."""
AT_ONCE = "at once"
"""The way (`Work.publish_by`) to send one stamped message as soon as it reaches a subscriber."""
IMAGE = "image"
"""The way to publish what a camera does, by rclpy: sensor_msgs/Image, with the profile for sensor data."""
_LOOP_NS = 2_000_000
_FILLING = "The quick brown fox jumps over the lazy dog. "
_BODY_AT = {kind: sys.getsizeof(kind()) - 1 for kind in (str, bytes)}
"""Where CPython keeps the characters of an ASCII `str`, and those of `bytes`: before their final NUL."""


class Work(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement. Messages are a `str` of `size` ASCII characters at both ends, or `bytes`.

    `rate` messages a second, or as fast as it goes without loss (0). `warm_up` messages come before those
    that count. `publish_by` and `take_by` choose between the ways in which a system can be used. For
    `busy_poll_s` after each message the subscriber looks for the next one without sleeping, where it can.
    `gives_turns`: the publisher is a program of asyncio, whose loop gets a turn after each paced message.
    `subscribers`: so many processes get every message. Of a paced stream of small ones `depth` bounds how far
    a process may be behind without a loss. `topic` is for measurements of several pairs on one bus. So many
    messages as `prefill` come before the publisher is ready, so that what grows with them has grown; when
    they are over, the subscriber says `warm`.
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
        """All messages."""
        return self.warm_up + self.count


class Arrivals(msgspec.Struct, frozen=True):
    """For each message in ns: how late the schedule was it sent, and how long after that it arrived."""

    late_ns: list[int]
    age_ns: list[int]


def text_of(size: int) -> str:
    """`size` characters of one byte each."""
    return (_FILLING * (size // len(_FILLING) + 1))[:size]


class Stamped:
    """A paced message of `size` characters, complete but for the time at which it is sent.

    The text is there before the clock is read: to make 1 MiB of it is no part of a message's way. The stamp
    is then written into it in place, which is safe only because nothing else refers to the text yet.
    """

    def __init__(self, size: int, due_ns: int, kind: type[str] | type[bytes] = str) -> None:
        head = f"{due_ns} "
        self._message: str | bytes = head.ljust(size) if kind is str else head.encode().ljust(size)
        self._at = id(self._message) + _BODY_AT[kind] + len(head)

    def now(self) -> Any:
        """The message, which is sent now."""
        stamp = b"%d" % monotonic_ns()
        memmove(self._at, stamp, len(stamp))
        return self._message


async def pace(send: Callable[[Any], object], work: Work, kind: type[str] | type[bytes] = str) -> None:
    """`send` warm-up and messages by a schedule that is fixed beforehand.

    A publisher that was held up sends at once what is overdue, and skips nothing (no coordinated omission):
    each message begins with the time at which it was due and the one at which it was sent. After each message
    the event loop gets a turn, if `work.gives_turns`. The process sleeps on its own, because the timers of
    uvloop have whole milliseconds.
    """
    period_ns = 1e9 / work.rate
    start_ns = monotonic_ns() + period_ns
    for number in range(work.total):
        due_ns = int(start_ns + number * period_ns)
        message = Stamped(work.size, due_ns, kind)
        if work.gives_turns and due_ns - monotonic_ns() > 2 * _LOOP_NS:
            # Much time: the loop has it, and may need it, to send what is large.
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
    """What the stamps in `heads`, of which the first `warm_up` don't count, say of the way."""
    late, age = [], []
    for head, now_ns in zip(heads, arrived_ns, strict=True):
        due_ns, sent_ns = map(int, head.split())
        late.append(sent_ns - due_ns)
        age.append(now_ns - sent_ns)
    return Arrivals(late_ns=late[work.warm_up :], age_ns=age[work.warm_up :])

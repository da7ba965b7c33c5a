"""What a publisher and a subscriber are to do, the same for every system: messages, their size, their rate.

Owns the payload's text and the pace. Must not know any system.
"""

import asyncio
from collections.abc import Callable, Iterable
from time import monotonic_ns, sleep

import msgspec

TOPIC = "bench"
_FILLING = "The quick brown fox jumps over the lazy dog. "


class Work(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement. Messages are a `str` of `size` ASCII characters at both ends.

    `rate` messages a second, or as fast as it goes without loss (0). `warm_up` messages come before those
    that count. `publish_by` and `take_by` choose between the ways in which a system can be used.
    """

    size: int
    count: int
    warm_up: int
    rate: float = 0.0
    publish_by: str = ""
    take_by: str = ""


class Arrivals(msgspec.Struct, frozen=True):
    """For each message in ns: how late the schedule was it sent, and how long after that it arrived."""

    late_ns: list[int]
    age_ns: list[int]


def text_of(size: int) -> str:
    """`size` characters of one byte each."""
    return (_FILLING * (size // len(_FILLING) + 1))[:size]


async def pace(send: Callable[[str], object], work: Work) -> None:
    """`send` warm-up and messages by a schedule that is fixed beforehand.

    Who is held up sends what is overdue at once, and does not skip it (no coordinated omission): each text
    begins with the time at which it was due and the one at which it was sent. After each message the event
    loop gets a turn. The process sleeps on its own, because the timers of uvloop have whole milliseconds.
    """
    period_ns = 1e9 / work.rate
    start_ns = monotonic_ns() + period_ns
    for number in range(work.warm_up + work.count):
        due_ns = int(start_ns + number * period_ns)
        rest_ns = due_ns - monotonic_ns()
        if rest_ns > 0:
            sleep(rest_ns / 1e9)  # noqa: ASYNC251
        send(f"{due_ns} {monotonic_ns()} ".ljust(work.size))
        await asyncio.sleep(0)


def arrivals(texts: Iterable[str], arrived_ns: Iterable[int], work: Work) -> Arrivals:
    """What the stamps in `texts`, of which the first `warm_up` don't count, say of the way."""
    late, age = [], []
    for text, now_ns in zip(texts, arrived_ns, strict=True):
        due_ns, sent_ns = map(int, text.split())
        late.append(sent_ns - due_ns)
        age.append(now_ns - sent_ns)
    return Arrivals(late_ns=late[work.warm_up :], age_ns=age[work.warm_up :])

"""The goals for the figures, in one place: the ratios at the beginning of the report.

The benchmark of its section computes each ratio within a repetition, from cases that are alike: event with
event, polling with polling, the same settings of malloc, the same kind of publisher.
"""

from collections.abc import Mapping
from typing import NamedTuple

import msgspec

from benchmarks.cases import Outcome
from benchmarks.report import Comparison, compare
from benchmarks.systems import (
    BUS,
    BUS_BYTES,
    BUS_SOCKET,
    ECAL,
    FLOOR,
    ICEORYX,
    PIPE,
    PYZMQ,
    PYZMQ_PROXY,
    tuned,
)
from benchmarks.versus import against


class Goal(NamedTuple):
    """The ratio of `key` of the case `ours` to `theirs`; the figure itself if `theirs` is empty."""

    section: str
    headline: str
    ours: str
    theirs: str
    key: str
    at_most: float | None = None
    at_least: float | None = None


_SMALL, _LONG, _LARGE = "64 B", "64 KiB", "1 MiB"
GOALS = (
    Goal(
        "latency",
        "64 B, p50 / barest Python program",
        f"{_SMALL}, {BUS.name}",
        f"{_SMALL}, {FLOOR.name}",
        "p50",
        0.9,
    ),
    Goal("latency", "64 B, p99 / eCAL", f"{_SMALL}, {BUS.name}", f"{_SMALL}, {ECAL.name}", "p99", 1.0),
    Goal(
        "latency",
        "64 B by socket, p50 / pyzmq's proxy",
        f"{_SMALL}, {BUS_SOCKET.name}",
        f"{_SMALL}, {PYZMQ_PROXY.name}",
        "p50",
        1.0,
    ),
    Goal(
        "cost",
        "CPU of messages that come one by one / Pipe",
        f"{_SMALL}, {BUS.name}",
        f"{_SMALL}, {PIPE.name}",
        "cpu",
        0.95,
    ),
    Goal(
        "cost",
        "the same by socket / pyzmq's proxy",
        f"{_SMALL}, {BUS_SOCKET.name}",
        f"{_SMALL}, {PYZMQ_PROXY.name}",
        "cpu",
        1.0,
    ),
    *(
        Goal(
            "fanout",
            f"until the last of {number} has it, p50 / iceoryx2",
            f"{number} subscribers, {BUS.name}",
            f"{number} subscribers, {ICEORYX.name}",
            "last_p50",
            0.8,
        )
        for number in (8, 16)
    ),
    Goal("throughput", "64 B, messages/s", f"{_SMALL}, {BUS.name}", "", "per_s", None, 4e6),
    Goal(
        "throughput",
        "64 B, messages/s: await send / publish",
        f"{_SMALL}, {BUS.name}, send",
        f"{_SMALL}, {BUS.name}",
        "per_s",
        None,
        0.9,
    ),
    Goal(
        "throughput",
        "64 B by socket, messages/s / pyzmq's proxy",
        f"{_SMALL}, {BUS_SOCKET.name}",
        f"{_SMALL}, {PYZMQ_PROXY.name}",
        "per_s",
        None,
        1.5,
    ),
    Goal(
        "throughput",
        "64 KiB by socket, bytes/s / pyzmq's proxy",
        f"{_LONG}, {BUS_SOCKET.name}",
        f"{_LONG}, {PYZMQ_PROXY.name}",
        "bytes_per_s",
        None,
        1.3,
    ),
    Goal(
        "throughput",
        "1 MiB by socket, bytes/s / pyzmq's proxy, malloc set alike",
        f"{_LARGE}, {tuned(BUS_SOCKET).name}",
        f"{_LARGE}, {tuned(PYZMQ_PROXY).name}",
        "bytes_per_s",
        None,
        1.3,
    ),
    Goal(
        "throughput",
        "64 KiB, bytes/s / iceoryx2, both by events",
        f"{_LONG}, {BUS.name}",
        f"{_LONG}, {ICEORYX.name}",
        "bytes_per_s",
        None,
        1.0,
    ),
    Goal(
        "bulk",
        "1 MiB loaned, bytes/s / memcpy",
        f"{_LARGE}, {BUS_BYTES.name}, loaned and viewed",
        f"{_LARGE}, C, memcpy",
        "bytes_per_s",
        None,
        0.6,
    ),
    Goal(
        "bulk",
        "1 MiB loaned, bytes/s / iceoryx2, both polling",
        f"{_LARGE}, {BUS_BYTES.name}, loaned and viewed, busy polling",
        f"{_LARGE}, {ICEORYX.name}, loaned and in place, busy polling",
        "bytes_per_s",
        None,
        1.0,
    ),
    Goal(
        "growth",
        "CPU of a delivery with 1,000 topics / with one",
        f"1000 topics: {BUS.name}",
        f"1 topics: {BUS.name}",
        "cpu",
        1.1,
    ),
    Goal(
        "startup",
        "first message / pyzmq's",
        f"first message, {BUS.name}",
        f"first message, {PYZMQ.name}",
        "ms",
        1.6,
    ),
    Goal(
        "startup",
        "first message of a listener / pyzmq's",
        f"first message of a listener, {BUS.name}",
        f"first message of a listener, {PYZMQ.name}",
        "ms",
        1.6,
    ),
)


def reached(section: str, outcomes: Mapping[str, Outcome]) -> list[Comparison]:
    """The goals of a section for which `outcomes` has figures."""
    found: list[Comparison] = []
    for one in GOALS:
        if one.section != section:
            continue
        if one.theirs:
            made = against(
                outcomes, one.ours, one.theirs, one.key, at_most=one.at_most, at_least=one.at_least
            )
        else:
            held = outcomes[one.ours].repetitions if one.ours in outcomes else []
            values = [figures[one.key] for figures in held if one.key in figures]
            made = compare(f"{one.ours}, {one.key}", values, at_most=one.at_most, at_least=one.at_least)
        found += [msgspec.structs.replace(each, headline=one.headline) for each in made]
    return found

"""A process of memory.py: makes endpoints on request, reports its memory, and keeps them."""

import asyncio
import gc
import sys
from pathlib import Path
from typing import NamedTuple

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

_PRIVATE = ("Private_Clean:", "Private_Dirty:")


class Holding(msgspec.Struct, frozen=True):
    """Numbers of endpoints with the default QoS."""

    number: int


class Usage(NamedTuple):
    """Memory of a process in KiB: its own, and the shared memory that it has mapped."""

    private: int
    shared: int


def usage_of(process: int | str) -> Usage:
    """The memory of a process now. Segments count with their reserved size, each once. Raises OSError."""
    private, is_segment, inode = 0, False, ""
    segments: dict[str, int] = {}
    for line in (Path("/proc") / str(process) / "smaps").read_text().splitlines():
        key, value, *_ = line.split()
        if not key.endswith(":"):
            is_segment, inode = "/memfd:" in line, line.split()[4]
        elif is_segment and key == "Size:":
            segments[inode] = int(value)
        elif not is_segment and key in _PRIVATE:
            private += int(value)
    return Usage(private, sum(segments.values()))


async def publisher(parent: Parent) -> None:
    number = options(Holding).number
    async with bus.Node("bench_publisher") as node:
        await node.create_publisher(String, "memory_0")  # loads and makes everything that endpoints share
        await _ready(parent)
        pubs = [await node.create_publisher(String, f"memory_{index}") for index in range(1, number + 1)]
        _made(parent)
        await parent.wait_for("matched")
        for pub in pubs:
            await pub.wait_for_subscriptions()
        _made(parent)
        await asyncio.Event().wait()


async def subscriber(parent: Parent) -> None:
    number = options(Holding).number
    async with bus.Node("bench_subscriber") as node:
        await node.create_subscription(String, "memory_0")
        await _ready(parent)
        for index in range(1, number + 1):
            await node.create_subscription(String, f"memory_{index}")
        _made(parent)
        await asyncio.Event().wait()


async def _ready(parent: Parent) -> None:
    gc.collect()
    parent.tell("ready")
    await parent.wait_for("go")


def _made(parent: Parent) -> None:
    gc.collect()
    parent.tell("made")


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])

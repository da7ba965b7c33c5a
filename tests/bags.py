"""Bags for tests: messages of std_msgs/msg/String, written by busd or other programs, and read by others."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytest.importorskip("mcap")  # for all modules that import this

from bus.qos import QoSProfile
from bus_bag.metadata import TopicMetadata
from bus_bag.storage import BagReader, BagWriter

START = 1795342862882115714
STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CHATTER = TopicMetadata("/chatter", STRING, "cdr", (QoSProfile(),), STRING_HASH)
LATCHED = TopicMetadata(
    "/latched", STRING, "cdr", (QoSProfile(1, durability="transient_local"),) * 2, STRING_HASH
)


class Said(NamedTuple):
    """A message; the order of the fields sorts by time."""

    log_time: int
    publish_time: int
    sequence: int
    topic: str
    text: str


def cdr(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def text_of(data: Any) -> str:
    return bytes(data[8:-1]).decode()


def said(count: int, *, first: int = 0, length: int = 0, step: int = 1_000_000) -> list[Said]:
    """Messages of two topics; each third is latched. Published 300 ns before they were received."""
    return [
        Said(
            START + number * step,
            START + number * step - 300,
            number,
            CHATTER.name if number % 3 else LATCHED.name,
            f"{number} ".ljust(length, "x"),
        )
        for number in range(first, first + count)
    ]


def begin_bag(folder: Path, **options: Any) -> tuple[BagWriter, dict[str, int]]:
    writer = BagWriter(folder, **options)
    channels = {
        topic.name: writer.add_topic(topic, "string data\n", {"busd.type_hash": "BUS01_1"})
        for topic in (CHATTER, LATCHED)
    }
    return writer, channels


def write(writer: BagWriter, channels: dict[str, int], messages: Iterable[Said]) -> None:
    for one in messages:
        data = cdr(one.text)
        parts: Sequence[bytes] = [data[:8], data[8:]]
        writer.write(channels[one.topic], one.log_time, one.publish_time, one.sequence, parts)


def write_bag(folder: Path, *files: list[Said], **options: Any) -> Path:
    """Write a bag with one file for each list."""
    writer, channels = begin_bag(folder, **options)
    for number, messages in enumerate(files):
        if number:
            writer.split()
        write(writer, channels, messages)
    writer.close()
    return folder


def read(reader: BagReader, **options: Any) -> list[Said]:
    return [
        Said(one.log_time, one.publish_time, one.sequence, one.topic, text_of(one.data))
        for one in reader.messages(**options)
    ]

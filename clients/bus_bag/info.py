"""The text of `bus bag info` about a bag, in rosbag2's form."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping

import msgspec

from bus_bag import losses
from bus_bag.metadata import BagMetadata, TopicInformation
from bus_bag.sizes import size_text
from bus_bag.storage import BagReader
from bus_bag.topic_names import SERVICE_EVENT, is_event_topic
from bus_plot.strips import Strip

__all__ = ["SORTINGS", "describe", "find_losses", "strips", "time_of_day", "topic_names"]

_INDENT = 19
_NS_PER_S = 1_000_000_000
_DAY_S = 86400

SORTINGS: Mapping[str, Callable[[TopicInformation], object]] = {
    "name": lambda one: one.topic_metadata.name,
    "type": lambda one: one.topic_metadata.type,
    "count": lambda one: one.message_count,
}
"""Sort keys of topics, by their names in the options."""


class _Service(msgspec.Struct):
    """Counts of a service, from reading its events."""

    requests: set[bytes] = msgspec.field(default_factory=set)
    responses: set[bytes] = msgspec.field(default_factory=set)


def describe(reader: BagReader, *, verbose: bool = False, sort: str = "name") -> str:
    """Describe the bag. `verbose` reads all messages, for the bytes of each topic and the calls of
    services."""
    metadata = reader.metadata
    sizes: Counter[str] = Counter()
    services: dict[str, _Service] = {}
    if verbose:
        _read(reader, sizes, services)
    topics = sorted(metadata.topics, key=SORTINGS[sort])  # type: ignore[arg-type]
    events = [one for one in topics if _is_event(one)]
    topics = [one for one in topics if not _is_event(one)]
    start, end = metadata.starting_time, metadata.starting_time + metadata.duration
    bag_size = sum(file.path.stat().st_size for file in reader.files)
    lines = [
        "",
        *_block("Files:", metadata.relative_file_paths),
        f"Bag size:          {size_text(bag_size)}",
        f"Storage id:        {metadata.storage_identifier}",
        f"ROS Distro:        {metadata.ros_distro or 'unknown'}",
        f"Duration:          {_seconds(metadata.duration)}s",
        f"Start:             {_moment(start)}",
        f"End:               {_moment(end)}",
        f"Messages:          {metadata.message_count}",
        *_block("Topic information:", [_topic_line(one, sizes if verbose else None) for one in topics]),
        f"Service:           {len(events)}",
        *_block(
            "Service information:",
            [_service_line(one, sizes, services if verbose else None) for one in events],
            _INDENT + 2,
        ),
    ]
    if lost := list(losses.lines(find_losses(reader))):
        lines += _block("Lost:", lost)
    return "\n".join(lines) + "\n"


def topic_names(metadata: BagMetadata, sort: str = "name") -> list[str]:
    """Names of topics, without topics of services' events."""
    topics = sorted(metadata.topics, key=SORTINGS[sort])  # type: ignore[arg-type]
    return [one.topic_metadata.name for one in topics if not _is_event(one)]


def find_losses(reader: BagReader) -> dict[str, losses.TopicLosses]:
    """The recorder's last counters of missing messages; empty if there are none."""
    for file in reversed(reader.files):
        for name, texts in reversed(file.records):
            if name == losses.RECORD:
                try:
                    return losses.from_record(texts)
                except ValueError:
                    continue
    return {}


def strips(topics: Mapping[str, losses.TopicLosses]) -> list[Strip]:
    """The losses over time of each topic that has lost messages. Raises ValueError if a record is broken."""
    return [
        Strip(topic, one.timeline, f"lost {sum(one.lost.values())} of {one.expected}")
        for topic, one in sorted(topics.items())
        if any(one.lost.values())
    ]


def time_of_day(at_s: int) -> str:
    """A time of a bag's clock, in local time; a time of simulation in seconds."""
    if at_s < _DAY_S:
        return f"{at_s} s"
    try:
        return time.strftime("%H:%M:%S", time.localtime(at_s))
    except (OverflowError, ValueError, OSError):
        return f"{at_s} s"


def _is_event(topic: TopicInformation) -> bool:
    """Whether the topic has the events of a service."""
    return is_event_topic(topic.topic_metadata.name, (topic.topic_metadata.type,))


def _block(title: str, lines: Iterable[str], indent: int = _INDENT) -> Iterator[str]:
    """Lines of a block: the title with the first line, the other lines below it."""
    head = title.ljust(indent)
    for line in lines:
        yield head + line
        head = " " * indent
    if not head.isspace():
        yield head


def _topic_line(one: TopicInformation, sizes: Mapping[str, int] | None) -> str:
    topic = one.topic_metadata
    size = "" if sizes is None else f"Size Contribution: {size_text(sizes[topic.name])} | "
    return (
        f"Topic: {topic.name} | Type: {topic.type} | Count: {one.message_count} | "
        f"{size}Serialization Format: {topic.serialization_format}"
    )


def _service_line(
    one: TopicInformation, sizes: Mapping[str, int], services: Mapping[str, _Service] | None
) -> str:
    topic = one.topic_metadata
    head = f"Service: {topic.name.removesuffix(SERVICE_EVENT)} | Type: {topic.type.removesuffix('_Event')} | "
    tail = f"Serialization Format: {topic.serialization_format}"
    if services is None:
        return f"{head}Event Count: {one.message_count} | {tail}"
    service = services.get(topic.name, _Service())
    return (
        f"{head}Request Count: {len(service.requests)} | Response Count: {len(service.responses)} | "
        f"Size Contribution: {size_text(sizes[topic.name])} | {tail}"
    )


def _read(reader: BagReader, sizes: Counter[str], services: dict[str, _Service]) -> None:
    events = {one.topic_metadata.name for one in reader.metadata.topics if _is_event(one)}
    for message in reader.messages():
        sizes[message.topic] += len(message.data)
        if message.topic in events and len(message.data) >= 44:
            # Events begin with a ServiceEventInfo: kind, time, the client and the number of its call.
            service = services.setdefault(message.topic, _Service())
            call = bytes(message.data[16:32]) + bytes(message.data[36:44])
            (service.requests if message.data[4] < 2 else service.responses).add(call)


def _seconds(duration: int) -> str:
    return f"{duration // _NS_PER_S}.{duration % _NS_PER_S:09d}"


def _moment(time_ns: int) -> str:
    """A time as text: in local time, and in seconds since 1970."""
    try:
        local = time.localtime(time_ns // _NS_PER_S)
    except (OverflowError, ValueError, OSError):
        return f"({_seconds(time_ns)})"
    day = f"{time.strftime('%b', local)} {local.tm_mday:2d} {local.tm_year}"
    return f"{day} {time.strftime('%H:%M:%S', local)}.{time_ns % _NS_PER_S:09d} ({_seconds(time_ns)})"

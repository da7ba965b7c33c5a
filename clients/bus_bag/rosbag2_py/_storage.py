"""Options, filters and metadata of bags, as programs make and get them."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import Any

import msgspec

from bus.qos import QoSProfile
from bus_bag import metadata as ours
from bus_bag.errors import BagError
from bus_bag.info import describe
from bus_bag.storage import BagReader
from bus_bag.storage.registry import DEFAULT
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.qos import from_native
from bus_ros.rclpy.time import Time

__all__ = [
    "BagMetadata",
    "ConverterOptions",
    "FileInformation",
    "MessageDefinition",
    "ReadOrder",
    "ReadOrderSortBy",
    "StorageFilter",
    "StorageOptions",
    "TopicInformation",
    "TopicMetadata",
    "convert_rclcpp_qos_to_rclpy_qos",
    "get_default_storage_id",
    "metadata_of",
    "topics_of",
    "with_errors_of_ros",
]


class ConverterOptions(msgspec.Struct):
    """Formats of messages; both are `cdr` or empty."""

    input_serialization_format: str = ""
    output_serialization_format: str = ""


class StorageOptions(msgspec.Struct):
    """A bag: its folder, and options to write it. Only a writer uses the other options."""

    uri: str
    storage_id: str = ""
    max_bagfile_size: int = 0
    max_bagfile_duration: int = 0
    max_cache_size: int = 0
    storage_preset_profile: str = ""
    storage_config_uri: str = ""
    snapshot_mode: bool = False
    start_time_ns: int = -1
    end_time_ns: int = -1
    custom_data: dict[str, str] = {}


class StorageFilter(msgspec.Struct):
    """Topics to read; empty lists and texts do not filter."""

    topics: list[str] = []
    services_events: list[str] = []
    regex: str = ""
    exclude_topics: list[str] = []
    exclude_service_events: list[str] = []
    regex_to_exclude: str = ""


class MessageDefinition(msgspec.Struct):
    """The definition of a type."""

    topic_type: str
    encoding: str
    encoded_message_definition: str
    type_hash: str


class TopicMetadata(msgspec.Struct):
    """A topic. ROS 2 Humble has no `id`, so it may be left out."""

    id: int = 0
    name: str = ""
    type: str = ""
    serialization_format: str = ""
    offered_qos_profiles: list[Any] = []
    type_description_hash: str = ""

    def equals(self, other: "TopicMetadata") -> bool:
        """Whether all fields except the number are equal."""
        return bool(msgspec.structs.replace(self, id=other.id) == other)


class TopicInformation(msgspec.Struct):
    """A topic, and its number of messages."""

    topic_metadata: TopicMetadata
    message_count: int


class FileInformation(msgspec.Struct):
    """A file of a bag."""

    path: str
    starting_time: Time
    duration: Duration
    message_count: int


class BagMetadata(msgspec.Struct, repr_omit_defaults=True):
    """The contents of a bag."""

    version: int = ours.VERSION
    bag_size: int = 0
    storage_identifier: str = ""
    relative_file_paths: list[str] = []
    files: list[FileInformation] = []
    duration: Duration = msgspec.field(default_factory=Duration)
    starting_time: Time = msgspec.field(default_factory=Time)
    message_count: int = 0
    topics_with_message_count: list[TopicInformation] = []
    compression_format: str = ""
    compression_mode: str = ""
    custom_data: dict[str, str] = {}
    ros_distro: str = ""


class _ReadMetadata(BagMetadata):
    """Metadata of a bag that was read: printed, it is the text of `bus bag info`."""

    text: str = ""

    def __repr__(self) -> str:
        return self.text


class ReadOrderSortBy(IntEnum):
    """The time by which messages are sorted."""

    ReceivedTimestamp = 0
    PublishedTimestamp = 1
    File = 2


class ReadOrder(msgspec.Struct):
    """The order in which a reader returns messages."""

    sort_by: ReadOrderSortBy = ReadOrderSortBy.ReceivedTimestamp
    reverse: bool = False


def get_default_storage_id() -> str:
    """The storage of bags if the writer names none."""
    return DEFAULT.identifier


def convert_rclcpp_qos_to_rclpy_qos(qos: QoSProfile) -> Any:
    """An offered profile of a topic as rclpy's QoSProfile."""
    return from_native(qos)


def topics_of(reader: BagReader) -> list[TopicMetadata]:
    """The topics of a bag."""
    return [
        TopicMetadata(
            number,
            topic.name,
            topic.type,
            topic.serialization_format,
            list(topic.offered_qos_profiles),
            topic.type_description_hash,
        )
        for number, topic in enumerate(reader.topics.values(), 1)
    ]


def metadata_of(reader: BagReader) -> BagMetadata:
    """The metadata of a bag."""
    found = reader.metadata
    counts = {one.topic_metadata.name: one.message_count for one in found.topics}
    return _ReadMetadata(
        version=found.version,
        bag_size=sum(file.path.stat().st_size for file in reader.files),
        storage_identifier=found.storage_identifier,
        relative_file_paths=list(found.relative_file_paths),
        files=[
            FileInformation(
                one.path,
                Time(nanoseconds=one.starting_time),
                Duration(nanoseconds=one.duration),
                one.message_count,
            )
            for one in found.files
        ],
        duration=Duration(nanoseconds=found.duration),
        starting_time=Time(nanoseconds=found.starting_time),
        message_count=found.message_count,
        topics_with_message_count=[TopicInformation(one, counts[one.name]) for one in topics_of(reader)],
        compression_format=found.compression_format,
        compression_mode=found.compression_mode,
        custom_data=dict(found.custom_data),
        ros_distro=found.ros_distro,
        text=describe(reader),
    )


@contextmanager
def with_errors_of_ros() -> Iterator[None]:
    """Raise RuntimeError for a bag that can't be read or written."""
    try:
        yield
    except (BagError, OSError) as error:
        raise RuntimeError(str(error)) from error

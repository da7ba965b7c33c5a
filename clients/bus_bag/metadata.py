"""Reads and writes metadata.yaml: a description of a bag, without its messages. Pure.

It is written as version 9, in ROS 2's order of keys; versions 1 to 9 are read. The `rosbag2` records of MCAP
files have the same contents, without the first line (`to_record`, `from_record`).
"""

import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from textwrap import indent
from typing import Any

import msgspec

from bus.qos import QoSProfile
from bus_bag.profiles import profile_to_yaml, profiles_from_yaml
from bus_bag.yaml_text import load

__all__ = [
    "NAME",
    "VERSION",
    "BagMetadata",
    "FileInformation",
    "TopicInformation",
    "TopicMetadata",
    "as_map",
    "from_record",
    "from_yaml",
    "profiles_to_text",
    "time_span",
    "to_record",
    "to_yaml",
]

NAME = "metadata.yaml"
VERSION = 9
_KEY = "rosbag2_bagfile_information"
_TOPICS = "topics_with_message_count"
_PLAIN = re.compile(r"(/[A-Za-z]\w*)+ [A-Za-z]\w*(/[A-Za-z]\w*)+ cdr RIHS01_[0-9a-f]{64}", re.ASCII)
"""Values that need no quotes in YAML."""
_MAX_NS = 2**63 - 1


class TopicMetadata(msgspec.Struct, frozen=True):
    """A topic of a bag."""

    name: str
    type: str
    """For example `sensor_msgs/msg/Imu`."""
    serialization_format: str = "cdr"
    offered_qos_profiles: tuple[QoSProfile, ...] = ()
    """One profile for each publisher seen."""
    type_description_hash: str = ""


class TopicInformation(msgspec.Struct, frozen=True):
    """A topic, and its number of messages in a bag."""

    topic_metadata: TopicMetadata
    message_count: int


class FileInformation(msgspec.Struct, frozen=True):
    """A file of a bag. Times are nanoseconds; the time of a message is its reception."""

    path: str
    """Path inside the bag's folder."""
    starting_time: int
    duration: int
    message_count: int


class BagMetadata(msgspec.Struct, frozen=True):
    """The contents of metadata.yaml. Times are nanoseconds."""

    storage_identifier: str = "mcap"
    starting_time: int = 0
    """The earliest reception of a message, in nanoseconds since 1970."""
    duration: int = 0
    message_count: int = 0
    topics: tuple[TopicInformation, ...] = ()
    files: tuple[FileInformation, ...] = ()
    relative_file_paths: tuple[str, ...] = ()
    compression_format: str = ""
    compression_mode: str = ""
    custom_data: Mapping[str, str] = {}
    ros_distro: str = ""
    version: int = VERSION


def time_span(files: Iterable[FileInformation]) -> tuple[int, int]:
    """The first reception of a message in these files, and the time from it to the last one; 0 without
    messages."""
    with_messages = [file for file in files if file.message_count]
    start = min((file.starting_time for file in with_messages), default=0)
    end = max((file.starting_time + file.duration for file in with_messages), default=0)
    return start, end - start


def to_yaml(metadata: BagMetadata) -> str:
    """Write the text of metadata.yaml."""
    return f"{_KEY}:\n{indent(to_record(metadata), '  ')}"


def to_record(metadata: BagMetadata) -> str:
    """Write the text of a `rosbag2` record for an MCAP file."""
    topics = "".join(
        f"{_topic_text(one.topic_metadata)}    message_count: {one.message_count}\n"
        for one in metadata.topics
    )
    text = _dump(as_map(msgspec.structs.replace(metadata, topics=())))
    return text.replace(f"{_TOPICS}: []\n", f"{_TOPICS}:\n{topics}", 1) if topics else text


@lru_cache(maxsize=1 << 14)
def _topic_text(topic: TopicMetadata) -> str:
    """The text of one topic in the list, without its count. Cached, because each file of a bag has it twice.

    The YAML library takes a millisecond or two for each topic. So it only writes topics that may need quotes.
    """
    words = f"{topic.name} {topic.type} {topic.serialization_format} {topic.type_description_hash}"
    if not topic.offered_qos_profiles or not _PLAIN.fullmatch(words):
        return indent(_dump([{"topic_metadata": _topic_map(topic)}]), "  ")
    profiles = indent(profiles_to_text(topic.offered_qos_profiles), " " * 8)
    return f"""\
  - topic_metadata:
      name: {topic.name}
      type: {topic.type}
      serialization_format: {topic.serialization_format}
      offered_qos_profiles:
{profiles}      type_description_hash: {topic.type_description_hash}
"""


@lru_cache(maxsize=1 << 10)
def profiles_to_text(profiles: tuple[QoSProfile, ...]) -> str:
    """The text `offered_qos_profiles` of a channel."""
    return _dump([profile_to_yaml(one) for one in profiles])


def as_map(metadata: BagMetadata) -> dict[str, object]:
    """The contents of both texts, as plain data."""
    return {
        "version": VERSION,
        "storage_identifier": metadata.storage_identifier,
        "duration": {"nanoseconds": metadata.duration},
        "starting_time": {"nanoseconds_since_epoch": metadata.starting_time},
        "message_count": metadata.message_count,
        _TOPICS: [
            {"topic_metadata": _topic_map(one.topic_metadata), "message_count": one.message_count}
            for one in metadata.topics
        ],
        "compression_format": metadata.compression_format,
        "compression_mode": metadata.compression_mode,
        "relative_file_paths": list(metadata.relative_file_paths),
        "files": [
            {
                "path": file.path,
                "starting_time": {"nanoseconds_since_epoch": file.starting_time},
                "duration": {"nanoseconds": file.duration},
                "message_count": file.message_count,
            }
            for file in metadata.files
        ],
        "custom_data": dict(metadata.custom_data) or None,
        "ros_distro": metadata.ros_distro,
    }


def _topic_map(topic: TopicMetadata) -> dict[str, object]:
    return {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": topic.serialization_format,
        "offered_qos_profiles": [profile_to_yaml(profile) for profile in topic.offered_qos_profiles],
        "type_description_hash": topic.type_description_hash,
    }


def _dump(value: object) -> str:
    """Write YAML like yaml-cpp: lists are indented, no value is `~`, and empty texts have double quotes."""
    import yaml

    class Dumper(yaml.SafeDumper):
        def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
            super().increase_indent(flow, False)

        def ignore_aliases(self, data: object) -> bool:
            return True

    def represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
        return dumper.represent_scalar("tag:yaml.org,2002:str", text, None if text else '"')

    def represent_none(dumper: yaml.SafeDumper, _: None) -> yaml.ScalarNode:
        return dumper.represent_scalar("tag:yaml.org,2002:null", "~")

    Dumper.add_representer(str, represent_text)
    Dumper.add_representer(type(None), represent_none)
    return str(yaml.dump(value, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=1 << 16))


def from_yaml(text: str) -> BagMetadata:
    """Read metadata.yaml. Raises ValueError with the reason if `text` is not valid."""
    document = load(text, has_aliases=False)
    if not isinstance(document, dict) or not isinstance(document.get(_KEY), dict):
        raise ValueError(f"it has no map '{_KEY}'")
    return _of_map(document[_KEY])


def from_record(text: str) -> BagMetadata:
    """Read a `rosbag2` record. Raises ValueError with the reason if `text` is not valid."""
    document = load(text, has_aliases=False)
    if not isinstance(document, dict):
        raise ValueError("it is not a map")
    return _of_map(document)


def _of_map(fields: dict[Any, Any]) -> BagMetadata:
    version = _number(fields, "version")
    if not 1 <= version <= VERSION:
        raise ValueError(f"version {version} is none of 1 to {VERSION}")
    topics = []
    for one in _list(fields, "topics_with_message_count"):
        topics.append(TopicInformation(_topic(_map(one, "topic_metadata")), _number(one, "message_count")))
    return BagMetadata(
        storage_identifier=_text(fields, "storage_identifier"),
        starting_time=_number(_map(fields, "starting_time"), "nanoseconds_since_epoch"),
        duration=_number(_map(fields, "duration"), "nanoseconds"),
        message_count=_number(fields, "message_count"),
        topics=tuple(topics),
        files=tuple(
            FileInformation(
                _text(one, "path"),
                _number(_map(one, "starting_time"), "nanoseconds_since_epoch"),
                _number(_map(one, "duration"), "nanoseconds"),
                _number(one, "message_count"),
            )
            for one in _list(fields, "files")
        ),
        relative_file_paths=tuple(
            _scalar("relative_file_paths", one) for one in _list(fields, "relative_file_paths")
        ),
        compression_format=_text(fields, "compression_format"),
        compression_mode=_text(fields, "compression_mode"),
        custom_data={
            _scalar("custom_data", key): _scalar("custom_data", value)
            for key, value in _map(fields, "custom_data").items()
        },
        ros_distro=_text(fields, "ros_distro"),
        version=version,
    )


def _topic(fields: dict[Any, Any]) -> TopicMetadata:
    return TopicMetadata(
        _text(fields, "name"),
        _text(fields, "type"),
        _text(fields, "serialization_format"),
        profiles_from_yaml(fields.get("offered_qos_profiles")),
        _text(fields, "type_description_hash"),
    )


def _text(fields: object, key: str) -> str:
    value = fields.get(key) if isinstance(fields, dict) else None
    return "" if value is None else _scalar(key, value)


def _scalar(key: str, value: object) -> str:
    """The text of a single value. `key` is for the error."""
    if isinstance(value, dict | list | set | tuple):
        raise ValueError(f"'{key}' has a list or a map instead of a text")
    return str(value)


def _number(fields: object, key: str) -> int:
    """Read a number; 0 if it is missing. For the start of a bag without messages, rosbag2 writes the largest
    number."""
    value = fields.get(key, 0) if isinstance(fields, dict) else 0
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"'{key}' is '{_scalar(key, value)}', not a whole number")
    if not 0 <= value <= _MAX_NS:
        raise ValueError(f"'{key}' is {value}, not between 0 and {_MAX_NS}")
    return value


def _list(fields: object, key: str) -> list[Any]:
    value = fields.get(key) if isinstance(fields, dict) else None
    if value is None:
        return []
    if not isinstance(value, list):
        raise ValueError(f"'{key}' is not a list")
    return value


def _map(fields: object, key: str) -> dict[Any, Any]:
    value = fields.get(key) if isinstance(fields, dict) else None
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ValueError(f"'{key}' is not a map")
    return value

"""Writes a bag, message by message."""

import weakref
from pathlib import Path
from typing import Any

from bus.errors import BusError
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag import metadata as ours
from bus_bag.record.splitting import Splitting
from bus_bag.rosbag2_py._storage import (
    ConverterOptions,
    StorageOptions,
    TopicMetadata,
    get_default_storage_id,
    with_errors_of_ros,
)
from bus_bag.storage import BagWriter
from bus_bag.storage.registry import writable_storage, writable_storages
from bus_ros.cdr import CdrError, Codec, codec_of

__all__ = ["SequentialWriter", "get_registered_writers"]

_MAX_TIME = 2**63 - 1


class SequentialWriter:
    """Writes a bag; it is complete after `close`, or after the end of the program.

    writer = rosbag2_py.SequentialWriter()
    writer.open(rosbag2_py.StorageOptions(uri="my_bag"), rosbag2_py.ConverterOptions())
    topic = rosbag2_py.TopicMetadata(name="/chatter", type="std_msgs/msg/String", serialization_format="cdr")
    writer.create_topic(topic)
    writer.write("/chatter", serialize_message(String(data="hi")), time_ns)
    """

    def __init__(self) -> None:
        self._bag: BagWriter | None = None
        self._splitting = Splitting(0, 0.0)
        self._start = self._end = -1
        self._channels: dict[str, tuple[int, Codec | None]] = {}
        self._finalizer: Any = None

    def open(self, storage_options: StorageOptions, converter_options: ConverterOptions) -> None:
        """Create the bag, a folder that does not exist yet.

        Raises RuntimeError if it can't be made, or for options without support: other formats than CDR, and
        `snapshot_mode`.
        """
        wanted = converter_options.output_serialization_format
        if wanted not in ("", "cdr"):
            raise RuntimeError(f"bags are written in the format 'cdr', not {wanted!r}")
        if storage_options.snapshot_mode:
            raise RuntimeError("snapshot_mode is not supported here; 'bus bag record --snapshot-mode' is")
        self.close()
        with with_errors_of_ros():
            self._bag = BagWriter(
                Path(storage_options.uri),
                storage=writable_storage(storage_options.storage_id or get_default_storage_id()),
                preset=storage_options.storage_preset_profile or "none",
                custom_data=storage_options.custom_data,
            )
        self._splitting = Splitting(
            storage_options.max_bagfile_size, float(storage_options.max_bagfile_duration)
        )
        self._start, self._end = storage_options.start_time_ns, storage_options.end_time_ns
        self._channels = {}
        self._finalizer = weakref.finalize(self, self._bag.close)  # also at the end of the program

    def create_topic(self, topic_with_type: TopicMetadata) -> None:
        """Add a topic. The definition of its type is in the workspace, or comes with busd."""
        bag, topic = self._opened("writing"), topic_with_type
        if topic.name in self._channels:
            return
        if topic.serialization_format not in ("", "cdr"):
            raise RuntimeError(
                f"topic '{topic.name}' has the format {topic.serialization_format!r}, not 'cdr'"
            )
        codec = _codec(topic.type)
        entry = ours.TopicMetadata(
            topic.name,
            topic.type,
            "cdr",
            tuple(topic.offered_qos_profiles),
            topic.type_description_hash or (codec.type_hash if codec else ""),
        )
        with with_errors_of_ros():
            self._channels[topic.name] = bag.add_topic(entry, codec.definition if codec else ""), codec

    def remove_topic(self, topic_with_type: TopicMetadata) -> None:
        """Accept no more messages of a topic."""
        self._opened("removing")
        self._channels.pop(topic_with_type.name, None)

    def write(
        self, topic_name: str, message: bytes, time_stamp: int, send_timestamp: int | None = None
    ) -> None:
        """Write a message: bytes of `serialize_message`, or CDR. Times are nanoseconds since 1970.

        Messages outside of `start_time_ns` and `end_time_ns` of the options are left out.

        Raises RuntimeError for a topic without `create_topic`, and for bytes that are no message of its type.
        """
        bag = self._opened("writing")
        if topic_name not in self._channels:
            raise RuntimeError(
                f"Failed to write on topic '{topic_name}'. Call create_topic() before first write."
            )
        channel, codec = self._channels[topic_name]
        sent = time_stamp if send_timestamp is None else send_timestamp
        if not (0 <= time_stamp <= _MAX_TIME and 0 <= sent <= _MAX_TIME):
            raise RuntimeError(f"the time of a message can't be {min(time_stamp, sent)}")
        if time_stamp < self._start or (self._end >= 0 and time_stamp > self._end):
            return
        parts = [message] if message[:1] == b"\0" else _encoded(message, codec, topic_name)
        with with_errors_of_ros():
            while self._splitting and self._splitting.is_due(bag.size + bag.gathered, time_stamp):
                bag.split()
                self._splitting.split(bag.size)
            bag.write(channel, time_stamp, sent, 0, parts)

    def split_bagfile(self) -> None:
        """Continue in the next file."""
        bag = self._opened("splitting")
        with with_errors_of_ros():
            bag.split()
        self._splitting.split(bag.size)

    def close(self) -> None:
        """Complete the bag."""
        if self._bag is not None:
            self._bag = None
            with with_errors_of_ros():
                self._finalizer()

    def _opened(self, purpose: str) -> BagWriter:
        if self._bag is None:
            raise RuntimeError(f"Bag is not open. Call open() before {purpose}.")
        return self._bag


def get_registered_writers() -> set[str]:
    """The names of the storages that can be written."""
    return {one.identifier for one in writable_storages()}


def _codec(type_name: str) -> Codec | None:
    """The codec of a type; None if there is no definition of it."""
    try:
        return codec_of(MessageSchema.of(message_class(type_name)))
    except (BusError, LookupError, ValueError):
        return None


def _encoded(payload: bytes, codec: Codec | None, topic: str) -> list[Any]:
    if codec is None:
        raise RuntimeError(
            f"topic '{topic}': no definition of its type was found, so only CDR can be written"
        )
    try:
        return list(codec.encode(payload))
    except CdrError as error:
        raise RuntimeError(f"topic '{topic}': {error}") from None

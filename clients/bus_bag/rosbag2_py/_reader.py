"""Reads the messages of a bag, one after the other."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from bus.errors import ConfigurationError
from bus_bag.rosbag2_py._storage import (
    BagMetadata,
    ConverterOptions,
    MessageDefinition,
    ReadOrder,
    ReadOrderSortBy,
    StorageFilter,
    StorageOptions,
    TopicMetadata,
    metadata_of,
    topics_of,
    with_errors_of_ros,
)
from bus_bag.storage import BagMessage, BagReader, open_bag
from bus_bag.storage.bag_file import Order
from bus_bag.storage.registry import storages
from bus_bag.topic_names import compiled, is_event_topic

__all__ = ["SequentialReader", "get_registered_readers"]

_ORDERS: Final[dict[ReadOrderSortBy, Order]] = {
    ReadOrderSortBy.ReceivedTimestamp: "log_time",
    ReadOrderSortBy.PublishedTimestamp: "publish_time",
}


class SequentialReader:
    """Reads a bag from its start, or from the time of `seek`.

        reader = rosbag2_py.SequentialReader()
        reader.open(rosbag2_py.StorageOptions(uri="my_bag"), rosbag2_py.ConverterOptions())
        while reader.has_next():
            topic, data, time_ns = reader.read_next()

    The data is CDR, which `rclpy.serialization.deserialize_message` accepts.
    """

    def __init__(self) -> None:
        self._bag: BagReader | None = None
        self._order: Order = "log_time"
        self._chosen: frozenset[str] | None = None
        """Topics to read; None: all."""
        self._messages: Iterator[BagMessage] = iter(())
        self._next: BagMessage | None = None
        self._start: int | None = None
        """The time of `seek`."""
        self._last: tuple[int, str] | None = None
        """Time and topic of the message returned last."""
        self._equal = 0
        """The number of messages with that time and topic that were returned."""

    def __del__(self) -> None:
        if self._bag is not None:
            self._bag.close()

    def open_uri(self, uri: str) -> None:
        """Open the bag in a folder, or a single file."""
        self.open(StorageOptions(uri), ConverterOptions())

    def open(self, storage_options: StorageOptions, converter_options: ConverterOptions) -> None:
        """Open the bag `storage_options.uri`; busd finds its storage itself.

        Raises RuntimeError if there is no bag, or if messages would need another format.
        """
        with with_errors_of_ros():
            bag = open_bag(Path(storage_options.uri))
        wanted = converter_options.output_serialization_format
        formats = {topic.serialization_format for topic in bag.topics.values()}
        if wanted and formats - {wanted}:
            bag.close()
            raise RuntimeError(f"the bag has messages in the format {formats.pop()!r}, not {wanted!r}")
        if self._bag is not None:
            self._bag.close()
        self._bag = bag
        self._order, self._chosen = "log_time", None
        self._restart(None)

    def set_read_order(self, order: ReadOrder) -> bool:
        """Set the order of messages, from the start of the bag; returns False for an order without support.

        Supported are ReceivedTimestamp and PublishedTimestamp, not reversed.
        """
        self._opened()
        by = _ORDERS.get(order.sort_by)
        if by is None or order.reverse:
            return False
        self._order = by
        self._restart(None)
        return True

    def has_next(self) -> bool:
        """Whether there is a further message."""
        self._opened()
        while self._next is None:
            with with_errors_of_ros():
                found = next(self._messages, None)
            if found is None:
                return False
            if self._chosen is None or found.topic in self._chosen:
                self._next = found
        return True

    def read_next(self) -> tuple[str, bytes, int]:
        """The topic, the bytes (CDR) and the time of reception of the next message.

        Raises RuntimeError at the end of the bag.
        """
        if not self.has_next():
            raise RuntimeError("Bag is at end. No next message.")
        message, self._next = self._next, None
        assert message is not None
        place = self._place(message)
        self._equal = self._equal + 1 if self._last == place else 1
        self._last = place
        return message.topic, bytes(message.data), message.log_time

    def seek(self, timestamp: int) -> None:
        """Continue with the first message received at that time or later; the filter stays."""
        self._opened()
        self._restart(timestamp)

    def set_filter(self, storage_filter: StorageFilter) -> None:
        """Return only messages of some topics from now on."""
        bag = self._opened()
        takes = _choice(storage_filter)
        self._chosen = frozenset(name for name, topic in bag.topics.items() if takes(name, topic.type))
        self._continue()

    def reset_filter(self) -> None:
        """Return messages of all topics from now on."""
        self._opened()
        self._chosen = None
        self._continue()

    def get_metadata(self) -> BagMetadata:
        """The contents of the bag."""
        return metadata_of(self._opened())

    def get_all_topics_and_types(self) -> list[TopicMetadata]:
        """The topics of the bag."""
        return topics_of(self._opened())

    def get_all_message_definitions(self) -> list[MessageDefinition]:
        """The definition of each type in the bag."""
        bag = self._opened()
        hashes = {topic.type: topic.type_description_hash for topic in bag.topics.values()}
        return [
            MessageDefinition(name, "ros2msg", bag.definitions.get(name, ""), type_hash)
            for name, type_hash in hashes.items()
        ]

    def _opened(self) -> BagReader:
        if self._bag is None:
            raise RuntimeError("Bag is not open. Call open() before reading.")
        return self._bag

    def _restart(self, start: int | None) -> None:
        """Read from that time on, or from the start of the bag."""
        self._start, self._next, self._last = start, None, None
        self._messages = self._opened().messages(start, self._chosen, self._order)

    def _continue(self) -> None:
        """Read on, with other topics: behind the message returned last."""
        bag, last = self._opened(), self._last
        if last is None:
            self._restart(self._start)
            return
        self._next = None
        start = last[0] if self._order == "log_time" else None
        self._messages = bag.messages(start, None, self._order)
        seen = 0
        while seen < self._equal and (found := next(self._messages, None)) is not None:
            seen += self._place(found) == last

    def _place(self, message: BagMessage) -> tuple[int, str]:
        return getattr(message, self._order), message.topic


def get_registered_readers() -> set[str]:
    """The names of the storages that can be read."""
    return {one.identifier for one in storages()}


def _choice(chosen: StorageFilter) -> Callable[[str, str], bool]:
    """A function of a topic and its type: whether a filter takes the topic."""
    wanted, unwanted = _pattern(chosen.regex), _pattern(chosen.regex_to_exclude)

    def takes(topic: str, type_name: str) -> bool:
        is_event = is_event_topic(topic, (type_name,))
        without = chosen.exclude_service_events if is_event else chosen.exclude_topics
        if topic in without or (unwanted is not None and unwanted.fullmatch(topic)):
            return False
        names = chosen.services_events if is_event else chosen.topics
        if not names and wanted is None:
            return True
        return topic in names or (wanted is not None and wanted.fullmatch(topic) is not None)

    return takes


def _pattern(text: str) -> re.Pattern[str] | None:
    try:
        return compiled(text)
    except ConfigurationError as error:
        raise RuntimeError(str(error)) from None

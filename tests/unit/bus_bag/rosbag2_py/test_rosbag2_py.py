"""Programs that read and write bags with rosbag2_py."""

import re
from pathlib import Path
from typing import Any

import pytest

from bags import CHATTER, LATCHED, START, STRING, STRING_HASH, cdr, said, text_of, write_bag
from bus.qos import QoSProfile
from bus_bag import rosbag2_py
from bus_bag.rosbag2_py import (
    ConverterOptions,
    ReadOrder,
    ReadOrderSortBy,
    SequentialReader,
    SequentialWriter,
    StorageFilter,
    StorageOptions,
    TopicMetadata,
)
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.serialization import deserialize_message, serialize_message
from bus_ros.rclpy.time import Time
from bus_ros.rosidl import message_class
from rows import for_each

String: Any = message_class(STRING)
PAGE = Path(__file__).parents[4] / "docs" / "bag.md"
EVENTS = TopicMetadata(name="/add/_service_event", type="example_interfaces/srv/AddTwoInts_Event")


def reader(folder: Path) -> SequentialReader:
    made = SequentialReader()
    made.open(StorageOptions(str(folder)), ConverterOptions("cdr", "cdr"))
    return made


def writer(folder: Path, *topics: TopicMetadata, **options: Any) -> SequentialWriter:
    made = SequentialWriter()
    made.open(StorageOptions(uri=str(folder), **options), ConverterOptions("", ""))
    for topic in topics:
        made.create_topic(topic)
    return made


def topic(name: str, type_name: str = STRING) -> TopicMetadata:
    return TopicMetadata(id=0, name=name, type=type_name, serialization_format="cdr")


def rest(source: SequentialReader) -> list[tuple[str, str, int]]:
    """Topic, text and time of the messages that are left."""
    found = []
    while source.has_next():
        name, data, time = source.read_next()
        found.append((name, deserialize_message(data, String).data, time))
    return found


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Six messages: 0 and 3 on /latched, the others on /chatter."""
    write_bag(tmp_path / "bag", said(6))
    return tmp_path / "bag"


def test_the_page_lists_the_names() -> None:
    section = PAGE.read_text().partition("\n## rosbag2_py\n")[2].partition("\n## ")[0]
    table = section.partition("| names |")[2].partition("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", table)) == set(rosbag2_py.__all__)


class TestReading:
    def test_all_messages(self, bag: Path) -> None:
        source = reader(bag)
        assert rest(source) == [(one.topic, one.text, one.log_time) for one in said(6)]
        assert not source.has_next()
        with pytest.raises(RuntimeError, match=r"Bag is at end\. No next message\."):
            source.read_next()

    def test_data_is_cdr(self, bag: Path) -> None:
        name, data, _ = reader(bag).read_next()
        assert (name, type(data), data) == (LATCHED.name, bytes, cdr("0 "))

    def test_a_filter_before_and_between_messages(self, bag: Path) -> None:
        source = reader(bag)
        source.set_filter(StorageFilter(topics=[CHATTER.name]))
        assert text_of(source.read_next()[1]) == "1 "
        assert source.has_next()
        source.set_filter(StorageFilter(topics=[LATCHED.name]))
        assert text_of(source.read_next()[1]) == "3 "
        source.reset_filter()
        assert [text for _, text, _ in rest(source)] == ["4 ", "5 "]

    def test_a_filter_between_messages_of_the_same_time(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/a"), topic("/b"))
        for name, text in (("/a", "1"), ("/a", "2"), ("/b", "3"), ("/a", "4"), ("/b", "5")):
            sink.write(name, cdr(text), 7)
        sink.close()
        source = reader(tmp_path / "bag")
        assert [text_of(source.read_next()[1]) for _ in range(2)] == ["1", "2"]
        source.reset_filter()
        assert text_of(source.read_next()[1]) == "3"
        source.set_filter(StorageFilter(topics=["/b"]))
        assert rest(source) == [("/b", "5", 7)]

    def test_seek_keeps_the_filter(self, bag: Path) -> None:
        source = reader(bag)
        source.set_filter(StorageFilter(topics=[CHATTER.name]))
        source.seek(said(6)[3].log_time)
        assert [text for _, text, _ in rest(source)] == ["4 ", "5 "]
        source.seek(0)
        source.reset_filter()
        assert len(rest(source)) == 6
        source.seek(START + 10**12)
        source.reset_filter()
        assert rest(source) == []

    @for_each(
        ("chosen", "topics"),
        [
            (StorageFilter(), ["/add/_service_event", "/ball", "/box"]),
            (StorageFilter(topics=["/box"]), ["/add/_service_event", "/box"]),
            (StorageFilter(["/box"], ["/none"]), ["/box"]),
            (StorageFilter(regex="/b.*"), ["/ball", "/box"]),
            (StorageFilter(regex="/b"), []),
            (StorageFilter(["/box"], regex="/a.*"), ["/add/_service_event", "/box"]),
            (StorageFilter(exclude_topics=["/box"]), ["/add/_service_event", "/ball"]),
            (StorageFilter(exclude_service_events=["/add/_service_event"]), ["/ball", "/box"]),
            (StorageFilter(["/box", "/ball"], regex_to_exclude=".*l"), ["/add/_service_event", "/box"]),
        ],
    )
    def test_filters(self, chosen: StorageFilter, topics: list[str], tmp_path: Path) -> None:
        if not (folder := tmp_path / "bag").exists():
            sink = writer(folder, EVENTS, topic("/box"), topic("/ball"))
            for name in ("/add/_service_event", "/box", "/ball"):
                sink.write(name, cdr(""), 1)
            sink.close()
        source = reader(folder)
        source.set_filter(chosen)
        found = []
        while source.has_next():
            found.append(source.read_next()[0])
        assert sorted(found) == topics

    def test_a_filter_that_is_no_expression(self, bag: Path) -> None:
        with pytest.raises(RuntimeError, match=r"'\(' is not a regular expression"):
            reader(bag).set_filter(StorageFilter(regex="("))

    def test_orders(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"))
        for text, received, sent in (("a", 10, 3), ("b", 20, 1), ("c", 30, 2)):
            sink.write("/t", cdr(text), received, sent)
        sink.close()
        source = reader(tmp_path / "bag")
        assert source.set_read_order(ReadOrder(ReadOrderSortBy.PublishedTimestamp))
        assert [text for _, text, _ in rest(source)] == ["b", "c", "a"]
        assert source.set_read_order(ReadOrder())
        assert [text for _, text, _ in rest(source)] == ["a", "b", "c"]
        assert not source.set_read_order(ReadOrder(reverse=True))
        assert not source.set_read_order(ReadOrder(ReadOrderSortBy.File))

    def test_topics_and_definitions(self, bag: Path) -> None:
        source = reader(bag)
        found = source.get_all_topics_and_types()
        assert [(one.id, one.name, one.type) for one in found] == [
            (1, CHATTER.name, STRING),
            (2, LATCHED.name, STRING),
        ]
        assert found[0].type_description_hash == STRING_HASH
        assert found[0].equals(rosbag2_py.TopicMetadata(7, *found[0].__reduce__()[1][1:]))
        profiles = [rosbag2_py.convert_rclcpp_qos_to_rclpy_qos(one) for one in found[1].offered_qos_profiles]
        assert [one.durability.name for one in profiles] == ["TRANSIENT_LOCAL"] * 2
        [definition] = source.get_all_message_definitions()
        assert definition.topic_type == STRING
        assert definition.encoding == "ros2msg"
        assert definition.encoded_message_definition == "string data\n"

    def test_metadata(self, bag: Path) -> None:
        messages = said(6)
        for metadata in (reader(bag).get_metadata(), rosbag2_py.Info().read_metadata(str(bag), "")):
            assert metadata.message_count == 6
            assert metadata.storage_identifier == "mcap"
            assert metadata.starting_time == Time(nanoseconds=START)
            assert metadata.duration == Duration(nanoseconds=messages[-1].log_time - START)
            assert [one.message_count for one in metadata.topics_with_message_count] == [4, 2]
            assert [one.path for one in metadata.files] == metadata.relative_file_paths == ["bag_0.mcap"]
            assert metadata.bag_size == (bag / "bag_0.mcap").stat().st_size
            assert "Messages:          6\n" in repr(metadata)

    def test_a_missing_bag(self, tmp_path: Path) -> None:
        with pytest.raises(RuntimeError, match=r"Bag path '.*none' does not exist!"):
            SequentialReader().open_uri(str(tmp_path / "none"))
        with pytest.raises(RuntimeError, match="does not exist"):
            rosbag2_py.Info().read_metadata(str(tmp_path / "none"), "mcap")

    def test_a_reader_that_is_not_open(self) -> None:
        for call in ("has_next", "read_next", "get_metadata", "get_all_topics_and_types", "reset_filter"):
            with pytest.raises(RuntimeError, match=r"Bag is not open\. Call open\(\) before reading\."):
                getattr(SequentialReader(), call)()

    def test_another_format(self, bag: Path) -> None:
        with pytest.raises(RuntimeError, match="the bag has messages in the format 'cdr', not 'json'"):
            SequentialReader().open(StorageOptions(str(bag)), ConverterOptions("", "json"))


class TestWriting:
    def test_messages_come_back(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"), topic("/t"))
        sink.write("/t", serialize_message(String(data="of the bus")), 100)
        sink.write("/t", cdr("of a bag"), 200)
        sink.close()
        sink.close()
        assert rest(reader(tmp_path / "bag")) == [("/t", "of the bus", 100), ("/t", "of a bag", 200)]
        [found] = reader(tmp_path / "bag").get_all_topics_and_types()
        assert found.type_description_hash == STRING_HASH

    def test_a_bag_is_complete_without_close(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"), custom_data={"robot": "7"})
        sink.write("/t", cdr("hi"), 100)
        del sink
        assert (tmp_path / "bag" / "metadata.yaml").exists()
        assert reader(tmp_path / "bag").get_metadata().custom_data == {"robot": "7"}

    def test_splitting(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"), max_bagfile_duration=1)
        for second in range(3):
            sink.write("/t", cdr(f"{second}"), second * 10**9)
        sink.split_bagfile()
        sink.write("/t", cdr("last"), 3 * 10**9)
        sink.close()
        metadata = reader(tmp_path / "bag").get_metadata()
        assert [file.message_count for file in metadata.files] == [1, 1, 1, 1]
        assert len(rest(reader(tmp_path / "bag"))) == 4

    def test_the_range_of_times(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"), start_time_ns=2, end_time_ns=3)
        for time in range(1, 5):
            sink.write("/t", cdr(f"{time}"), time)
        sink.close()
        assert [text for _, text, _ in rest(reader(tmp_path / "bag"))] == ["2", "3"]

    def test_offered_profiles(self, tmp_path: Path) -> None:
        latched = rosbag2_py.TopicMetadata(
            name="/t",
            type=STRING,
            serialization_format="cdr",
            offered_qos_profiles=[QoSProfile(1, durability="transient_local")],
        )
        writer(tmp_path / "bag", latched).close()
        [found] = reader(tmp_path / "bag").get_all_topics_and_types()
        assert found.offered_qos_profiles == latched.offered_qos_profiles

    def test_topics_that_are_not_there(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"))
        with pytest.raises(RuntimeError, match=r"Failed to write on topic '/other'\. Call create_topic\(\)"):
            sink.write("/other", cdr("hi"), 1)
        sink.remove_topic(topic("/t"))
        with pytest.raises(RuntimeError, match="Failed to write on topic '/t'"):
            sink.write("/t", cdr("hi"), 1)

    def test_bytes_that_are_no_message(self, tmp_path: Path) -> None:
        sink = writer(tmp_path / "bag", topic("/t"), topic("/unknown", "no_msgs/msg/None"))
        with pytest.raises(RuntimeError, match="topic '/t': no payload of std_msgs/msg/String"):
            sink.write("/t", b"\x91\x05", 1)
        with pytest.raises(RuntimeError, match="topic '/unknown': no definition of its type was found"):
            sink.write("/unknown", b"\x91\x05", 1)
        sink.write("/unknown", cdr("hi"), 1)
        for time in (-1, 2**63):
            with pytest.raises(RuntimeError, match="the time of a message can't be"):
                sink.write("/t", cdr("hi"), time)

    def test_options_without_support(self, bag: Path, tmp_path: Path) -> None:
        new = str(tmp_path / "new")
        for options, formats, text in (
            (StorageOptions(str(bag)), ConverterOptions(), r"Output folder '.*bag' already exists\."),
            (StorageOptions(new, "sqlite3"), ConverterOptions(), "storage_id 'sqlite3' can't be written"),
            (StorageOptions(new, snapshot_mode=True), ConverterOptions(), "snapshot_mode is not supported"),
            (StorageOptions(new), ConverterOptions("", "json"), "in the format 'cdr', not 'json'"),
        ):
            with pytest.raises(RuntimeError, match=text):
                SequentialWriter().open(options, formats)
        with pytest.raises(RuntimeError, match="topic '/t' has the format 'json', not 'cdr'"):
            writer(tmp_path / "new").create_topic(rosbag2_py.TopicMetadata(0, "/t", STRING, "json"))

    def test_a_writer_that_is_not_open(self) -> None:
        with pytest.raises(RuntimeError, match=r"Bag is not open\. Call open\(\) before writing\."):
            SequentialWriter().write("/t", b"", 0)

    def test_storages(self) -> None:
        assert rosbag2_py.get_registered_readers() == {"mcap", "sqlite3"}
        assert rosbag2_py.get_registered_writers() == {"mcap"}
        assert rosbag2_py.get_default_storage_id() == "mcap"

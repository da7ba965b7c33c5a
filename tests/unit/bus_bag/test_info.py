"""The description of a bag."""

import os
import time
from pathlib import Path

import pytest

from bags import CHATTER, START, begin_bag, cdr, said, write, write_bag
from bus_bag.info import describe, topic_names
from bus_bag.losses import RECORD, TopicLosses, to_record
from bus_bag.metadata import BagMetadata, TopicMetadata
from bus_bag.sizes import size_text
from bus_bag.storage import open_bag

TEXT = """
Files:             walk_0.mcap
                   walk_1.mcap
Bag size:          {size}
Storage id:        mcap
ROS Distro:        jazzy
Duration:          0.009000000s
Start:             Nov 22 2026 10:21:02.882115714 (1795342862.882115714)
End:               Nov 22 2026 10:21:02.891115714 (1795342862.891115714)
Messages:          10
Topic information: Topic: /chatter | Type: std_msgs/msg/String | Count: 6 | Serialization Format: cdr
                   Topic: /latched | Type: std_msgs/msg/String | Count: 4 | Serialization Format: cdr
Service:           0
Service information:\x20
"""


@pytest.fixture(autouse=True)
def utc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "TZ", "UTC")
    time.tzset()


def test_the_text(tmp_path: Path) -> None:
    messages = said(10)
    folder = write_bag(tmp_path / "walk", messages[:5], messages[5:])
    size = sum(path.stat().st_size for path in folder.glob("*.mcap"))
    with open_bag(folder) as reader:
        assert describe(reader) == TEXT.format(size=size_text(size))
        verbose = describe(reader, verbose=True)
        assert "/chatter | Type: std_msgs/msg/String | Count: 6 | Size Contribution: 66 B | Serial" in verbose
        counted = describe(reader, sort="count").splitlines()
        assert "Topic: /latched" in counted[10]
        assert topic_names(reader.metadata) == ["/chatter", "/latched"]
        assert topic_names(reader.metadata, "count") == ["/latched", "/chatter"]


def test_what_is_missing(tmp_path: Path) -> None:
    """The last record counts. The text names only topics with losses."""
    writer, channels = begin_bag(tmp_path / "walk")
    write(writer, channels, said(10))
    whole, lacking = TopicLosses(6, 6), TopicLosses(9, 4, 0, {"recorder_cache": 3, "replaced": 2})
    writer.write_metadata(RECORD, to_record({"/chatter": TopicLosses(1, 0, 0, {"replaced": 1})}))
    writer.write_metadata(RECORD, to_record({"/chatter": whole, "/latched": lacking}))
    writer.write_metadata(RECORD, {"/chatter": "[]"})
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert describe(reader).splitlines()[-2:] == [
            "Service information: ",
            "Lost:              /latched: 5 of 9 (recorder_cache: 3, replaced: 2)",
        ]
    with open_bag(write_bag(tmp_path / "other", said(1))) as reader:
        assert "Lost" not in describe(reader)


def test_nothing_in_it(tmp_path: Path) -> None:
    with open_bag(write_bag(tmp_path / "walk", [], ros_distro="")) as reader:
        lines = describe(reader).splitlines()
    assert lines[4:9] == [
        "ROS Distro:        unknown",
        "Duration:          0.000000000s",
        "Start:             Jan  1 1970 00:00:00.000000000 (0.000000000)",
        "End:               Jan  1 1970 00:00:00.000000000 (0.000000000)",
        "Messages:          0",
    ]


def test_services(tmp_path: Path) -> None:
    """Users do not see the events of services as topics. A call has events at both ends, and counts once."""
    writer, channels = begin_bag(tmp_path / "walk")
    topic = TopicMetadata("/add/_service_event", "example_interfaces/srv/AddTwoInts_Event")
    events = writer.add_topic(topic, "uint8 event_type\n")
    for number, (kind, client, call) in enumerate([(0, 1, 1), (1, 1, 1), (2, 1, 1), (3, 1, 1), (0, 2, 1)]):
        data = bytes((0, 1, 0, 0, kind)) + bytes(11) + bytes((client,)) * 16 + bytes(4) + bytes((call,)) * 8
        writer.write(events, START + number, START, 0, [data])
    writer.write(channels[CHATTER.name], START, START, 0, [cdr("a")])
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert topic_names(reader.metadata) == ["/chatter", "/latched"]
        assert describe(reader).splitlines()[-2:] == [
            "Service:           1",
            "Service information: Service: /add | Type: example_interfaces/srv/AddTwoInts | Event Count: 5 | "
            "Serialization Format: cdr",
        ]
        assert "Request Count: 2 | Response Count: 1 | Size Contribution: 220 B" in describe(
            reader, verbose=True
        )


def test_times_of_nobody(tmp_path: Path) -> None:
    """Every time in a file can be printed."""
    writer, channels = begin_bag(tmp_path / "walk")
    writer.write(channels[CHATTER.name], 2**64 - 1, 0, 0, [cdr("a")])
    writer.write(channels[CHATTER.name], 0, 0, 0, [cdr("a")])
    writer.close()
    (tmp_path / "walk" / "metadata.yaml").unlink()
    with open_bag(tmp_path / "walk") as reader:
        assert "(18446744073.709551615)" in describe(reader)
        assert BagMetadata().duration == 0

"""Conversion of bags."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader

from bags import (
    CHATTER,
    LATCHED,
    START,
    STRING,
    STRING_HASH,
    begin_bag,
    cdr,
    read,
    said,
    text_of,
    write,
    write_bag,
)
from bus.errors import ConfigurationError
from bus_bag.convert import convert, read_outputs
from bus_bag.errors import BagError
from bus_bag.info import find_losses
from bus_bag.losses import RECORD, TopicLosses, to_record
from bus_bag.metadata import TopicMetadata
from bus_bag.storage import open_bag
from bus_bag.storage.mcap_reader import McapFile
from rosbags_writer import write_as_rosbags
from rows import for_each

HIDDEN = TopicMetadata("/_hidden", STRING, "cdr", (), STRING_HASH)
EVENTS = TopicMetadata("/add/_service_event", "example_interfaces/srv/AddTwoInts_Event")


def outputs(*entries: dict[str, Any]) -> str:
    return str(yaml.safe_dump({"output_bags": list(entries)}))


def converted(tmp_path: Path, *inputs: Path, **options: Any) -> tuple[Path, list[str]]:
    """The new bag and the warnings."""
    target = tmp_path / "converted"
    heard: list[tuple[int, int]] = []
    warnings = convert(
        inputs,
        read_outputs(outputs({"uri": str(target), **options})),
        lambda done, total: heard.append((done, total)),
    )
    assert heard[-1][0] <= heard[-1][1]
    return target, warnings


def test_the_same_again(tmp_path: Path) -> None:
    messages = said(3000, length=500)
    folder = write_bag(tmp_path / "walk", messages[:1000], messages[1000:], custom_data={"robot": "7"})
    target, warnings = converted(tmp_path, folder)
    assert warnings == []
    with open_bag(folder) as before, open_bag(target) as after:
        assert read(after) == messages
        assert (after.topics, after.extra, after.definitions) == (
            before.topics,
            before.extra,
            before.definitions,
        )
        assert after.metadata.custom_data == {"robot": "7"}
        assert [file.path for file in after.metadata.files] == ["converted_0.mcap"]


def test_out_of_a_database(tmp_path: Path) -> None:
    messages = write_as_rosbags(tmp_path / "walk")
    target, warnings = converted(
        tmp_path, tmp_path / "walk", compression_mode="file", compression_format="zstd"
    )
    assert warnings == []
    with open_bag(target) as reader:
        assert read(reader) == messages
        assert [file.is_compressed for file in reader.files if isinstance(file, McapFile)] == [True]
    with AnyReader([target]) as others:
        assert [text_of(raw) for _, _, raw in others.messages()] == [one.text for one in messages]


def test_types_that_the_bag_does_not_describe(tmp_path: Path) -> None:
    writer, _ = begin_bag(tmp_path / "walk")
    unknown = writer.add_topic(TopicMetadata("/other", "nobody_msgs/msg/Nothing"), "")
    known = writer.add_topic(TopicMetadata("/name", STRING), "")
    for channel in (unknown, known):
        writer.write(channel, START, START, 0, [cdr("a")])
    writer.close()
    target, warnings = converted(tmp_path, tmp_path / "walk", topics=["/other", "name"])
    assert warnings == [
        "topic '/other': no definition of nobody_msgs/msg/Nothing found; it is copied without one"
    ]
    with open_bag(target) as reader:
        assert [one.topic for one in read(reader)] == ["/other", "/name"]
        assert reader.definitions[STRING] == "string data\n"


def test_several_bags_into_several(tmp_path: Path) -> None:
    messages = said(900)
    first, second = write_bag(tmp_path / "a", messages[::2]), write_bag(tmp_path / "b", messages[1::2])
    text = outputs(
        {"uri": str(tmp_path / "all"), "storage_id": "mcap", "all": True, "max_bagfile_duration": 0.3},
        {"uri": str(tmp_path / "one"), "topics": [CHATTER.name], "custom_data": {"a": 1}},
        {
            "uri": str(tmp_path / "part"),
            "start_time_ns": messages[10].log_time,
            "end_time_ns": messages[20].log_time,
        },
    )
    convert([first, second], read_outputs(text), lambda done, total: None)
    with open_bag(tmp_path / "all") as reader:
        assert read(reader) == messages
        assert [file.message_count for file in reader.metadata.files] == [300, 300, 300]
        assert reader.topics[CHATTER.name].offered_qos_profiles == CHATTER.offered_qos_profiles
    with open_bag(tmp_path / "one") as reader:
        assert read(reader) == [one for one in messages if one.topic == CHATTER.name]
        assert (list(reader.topics), reader.metadata.custom_data) == ([CHATTER.name], {"a": "1"})
    with open_bag(tmp_path / "part") as reader:
        assert read(reader) == messages[10:21]


def test_files_smaller_than_a_chunk(tmp_path: Path) -> None:
    messages = said(100, length=1000)
    target, _ = converted(tmp_path, write_bag(tmp_path / "walk", messages), max_bagfile_size=20_000)
    with open_bag(target) as reader:
        assert read(reader) == messages
        counts = [file.message_count for file in reader.metadata.files]
    assert len(counts) > 4
    assert all(15 <= count <= 20 for count in counts[:-1])


def test_topics_of_two_types(tmp_path: Path) -> None:
    bags = [write_bag(tmp_path / "a", said(3))]
    for type_name in ("std_msgs/msg/Header", STRING):
        bags.append(tmp_path / type_name.replace("/", "_"))
        writer, _ = begin_bag(bags[-1])
        channel = writer.add_topic(TopicMetadata("/third", type_name), "string data\n")
        writer.write(channel, START, START, 0, [cdr("a")])
        writer.close()
    target, warnings = converted(tmp_path, *bags)
    assert [line.partition(": ")[2] for line in warnings] == [
        "topic '/third' is std_msgs/msg/String here and std_msgs/msg/Header before; left out"
    ]
    with open_bag(target) as reader:
        assert len(list(reader.messages())) == 4


@for_each(
    ("options", "names"),
    [
        ({}, ["/_hidden", "/add/_service_event", "/chatter", "/latched"]),
        ({"all": True}, ["/add/_service_event", "/chatter", "/latched"]),
        ({"all_topics": True}, ["/chatter", "/latched"]),
        ({"all_topics": True, "include_hidden_topics": True}, ["/_hidden", "/chatter", "/latched"]),
        ({"all_services": True}, ["/add/_service_event"]),
        ({"services": ["/add"]}, ["/add/_service_event"]),
        ({"regex": "lat"}, ["/latched"]),
        ({"topic_types": [STRING], "exclude_regex": "lat"}, ["/chatter"]),
        ({"exclude_topics": ["/latched"]}, ["/add/_service_event", "/chatter"]),
    ],
)
def test_which_topics(
    tmp_path_factory: pytest.TempPathFactory, options: dict[str, Any], names: list[str]
) -> None:
    folder = tmp_path_factory.mktemp("choice")
    writer, _ = begin_bag(folder / "walk")
    for topic in (HIDDEN, EVENTS):
        writer.add_topic(topic, "string data\n")
    writer.close()
    target, _ = converted(folder, folder / "walk", **options)
    with open_bag(target) as reader:
        assert list(reader.topics) == names


def test_what_was_lost_is_kept(tmp_path: Path) -> None:
    writer, channels = begin_bag(tmp_path / "walk")
    write(writer, channels, said(10))
    lost = {topic: TopicLosses(9, 4, 0, {"replaced": 5}) for topic in (CHATTER.name, LATCHED.name)}
    writer.write_metadata(RECORD, to_record(lost))
    writer.close()
    target, _ = converted(tmp_path, tmp_path / "walk", topics=[CHATTER.name])
    with open_bag(target) as reader:
        assert find_losses(reader) == {CHATTER.name: lost[CHATTER.name]}


@for_each(
    ("text", "reason"),
    [
        ("[1", "it is not YAML"),
        ("other: 1", "it has no list 'output_bags'"),
        ("output_bags: []", "it has no list 'output_bags'"),
        ("output_bags: [1]", "an entry of 'output_bags' is not a map"),
        ("output_bags: [{topics: [/a]}]", "an entry of 'output_bags' has no 'uri'"),
        ("output_bags: [{uri: a, storage_id: sqlite3}]", "storage_id 'sqlite3' can't be written"),
        ("output_bags: [{uri: a, topcis: [/a]}]", "Unknown output option 'topcis'; did you mean 'topics'?"),
        ("output_bags: [{uri: a, topics: /a}]", "output option 'topics' can't be '/a'"),
        (
            "output_bags: [{uri: a, max_bagfile_size: -1}]",
            "output option 'max_bagfile_size' may not be negative",
        ),
        ("output_bags: [{uri: a, compression_mode: zip}]", "compression_mode 'zip' is none of"),
        ("output_bags: [{uri: a, compression_format: lz4}]", "compression_format 'lz4' can't be written"),
        (
            "output_bags: [{uri: a, compression_mode: file, storage_preset_profile: fastwrite}]",
            "compression_mode compresses chunks, and a file of 'fastwrite' has none",
        ),
    ],
)
def test_options_that_are_none(text: str, reason: str) -> None:
    with pytest.raises(BagError) as refused:
        read_outputs(text)
    assert str(refused.value).startswith(reason)


@for_each(
    ("preset", "expected"),
    [("", "zstd_fast"), ("none", "zstd_fast"), ("zstd_small", "zstd_small")],
)
def test_the_preset_of_a_compressed_bag(preset: str, expected: str) -> None:
    text = f"output_bags: [{{uri: a, compression_mode: file, storage_preset_profile: '{preset}'}}]"
    assert [one.preset for one in read_outputs(text)] == [expected]


def test_refused(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", said(1))
    with pytest.raises(BagError, match=r"^Output folder '.*/walk' already exists\.$"):
        convert([folder], read_outputs(outputs({"uri": str(folder)})), lambda done, total: None)
    with pytest.raises(ConfigurationError, match=r"^'\(' is not a regular expression"):
        converted(tmp_path, folder, regex="(")
    with pytest.raises(BagError, match=r"^unknown MCAP storage preset profile"):
        converted(tmp_path, folder, storage_preset_profile="tiny")
    assert [path.name for path in tmp_path.iterdir()] == ["walk"]

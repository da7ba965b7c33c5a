"""metadata.yaml, written and read."""

from collections.abc import Callable

import msgspec
import pytest

from bags import CHATTER, LATCHED, START
from bus_bag import metadata
from bus_bag.metadata import (
    BagMetadata,
    FileInformation,
    TopicInformation,
    from_record,
    from_yaml,
    to_record,
    to_yaml,
)
from rows import for_each

BAG = BagMetadata(
    starting_time=START,
    duration=5,
    message_count=3,
    topics=(TopicInformation(CHATTER, 2), TopicInformation(LATCHED, 1)),
    files=(FileInformation("walk_0.mcap", START, 5, 3),),
    relative_file_paths=("walk_0.mcap",),
    ros_distro="jazzy",
)
TEXT = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 5
  starting_time:
    nanoseconds_since_epoch: 1795342862882115714
  message_count: 1
  topics_with_message_count:
    - topic_metadata:
        name: /chatter
        type: std_msgs/msg/String
        serialization_format: cdr
        offered_qos_profiles:
          - history: keep_last
            depth: 10
            reliability: reliable
            durability: volatile
            deadline:
              sec: 9223372036
              nsec: 854775807
            lifespan:
              sec: 9223372036
              nsec: 854775807
            liveliness: automatic
            liveliness_lease_duration:
              sec: 9223372036
              nsec: 854775807
            avoid_ros_namespace_conventions: false
        type_description_hash: RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18
      message_count: 1
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - walk_0.mcap
  files:
    - path: walk_0.mcap
      starting_time:
        nanoseconds_since_epoch: 1795342862882115714
      duration:
        nanoseconds: 5
      message_count: 1
  custom_data: ~
  ros_distro: jazzy
"""
OF_HUMBLE = """\
rosbag2_bagfile_information:
  compression_format: ''
  compression_mode: ''
  duration: {nanoseconds: 4531096768}
  message_count: 20
  relative_file_paths: [talker.db3]
  starting_time: {nanoseconds_since_epoch: 1585866235112411371}
  storage_identifier: sqlite3
  topics_with_message_count:
  - message_count: 10
    topic_metadata:
      name: /chatter
      offered_qos_profiles: "- {history: 3, depth: 0, reliability: 1, durability: 1}"
      serialization_format: cdr
      type: std_msgs/msg/String
  version: 4
"""


def test_the_text_is_rosbag2s() -> None:
    one = BagMetadata(
        starting_time=START,
        duration=5,
        message_count=1,
        topics=(TopicInformation(CHATTER, 1),),
        files=(FileInformation("walk_0.mcap", START, 5, 1),),
        relative_file_paths=("walk_0.mcap",),
        ros_distro="jazzy",
    )
    assert to_yaml(one) == TEXT
    body = TEXT.split("\n", 1)[1]
    assert to_record(one) == "".join(f"{line[2:]}\n" for line in body.splitlines())


def test_both_ways() -> None:
    assert from_yaml(to_yaml(BAG)) == BAG
    assert from_record(to_record(BAG)) == BAG
    own = BagMetadata(custom_data={"robot": "7", "note": '1.5: "a"\nb', "": ""}, ros_distro="")
    assert from_yaml(to_yaml(own)) == own


def test_an_old_version() -> None:
    bag = from_yaml(OF_HUMBLE)
    assert (bag.version, bag.storage_identifier, bag.message_count) == (4, "sqlite3", 20)
    topic = bag.topics[0].topic_metadata
    assert (topic.name, topic.type_description_hash) == ("/chatter", "")
    assert (topic.offered_qos_profiles[0].depth, topic.offered_qos_profiles[0].durability) == (
        10,
        "transient_local",
    )


HEAD = "rosbag2_bagfile_information: {version: 9, "
LAUGHS = "z0: &z0 [x]\n" + "".join(f"z{n}: &z{n} [*z{n - 1}, *z{n - 1}]\n" for n in range(1, 18))
"""Short texts that stand for a list of 2^17 texts, and for a map that is merged as often."""
MERGED = "z0: &z0 {x: y}\n" + "".join(f"z{n}: &z{n} {{<<: [*z{n - 1}, *z{n - 1}]}}\n" for n in range(1, 18))


def test_a_star_in_a_text_is_no_alias() -> None:
    assert from_yaml(HEAD + "custom_data: {note: 'a * b', glob: \"*.mcap\"}}").custom_data == {
        "note": "a * b",
        "glob": "*.mcap",
    }


@for_each(
    ("text", "reason"),
    [
        ("", "it has no map 'rosbag2_bagfile_information'"),
        ("[1", "it is not YAML, line "),
        ("rosbag2_bagfile_information: 3", "it has no map"),
        ("rosbag2_bagfile_information: {version: 10}", "version 10 is none of 1 to 9"),
        ("rosbag2_bagfile_information: {version: 9, message_count: -1}", "'message_count' is -1"),
        ("rosbag2_bagfile_information: {version: 9, message_count: x}", "'message_count' is 'x'"),
        ("rosbag2_bagfile_information: {version: 9, files: 1}", "'files' is not a list"),
        ("rosbag2_bagfile_information: {version: 9, duration: 1}", "'duration' is not a map"),
        ("[" * 3_000, "it is nested too deeply"),
        ("[1, " * 2_001, "it is "),
        ("- " * 1_000, "it is nested too deeply"),
        ("a: \x01", "it is not YAML: unacceptable character #x0001: "),
        ("a: 2026-13-45", "it is not YAML: month must be"),
        ("a: 1" + ":1" * 5_000, "it has too long a number to the base 60"),
        ("a: 1" + ":1" * 5_000 + ".0", "it has too long a number to the base 60"),
        (HEAD + "relative_file_paths: [[x]]}", "'relative_file_paths' has a list or a map instead"),
        (HEAD + "custom_data: {x: {}}}", "'custom_data' has a list or a map instead of a text"),
        (HEAD + "ros_distro: !!set {x}}", "'ros_distro' has a list or a map instead of a text"),
        (HEAD + "message_count: [1]}", "'message_count' has a list or a map instead of a text"),
        (LAUGHS + HEAD + "ros_distro: *z17}", "it has an alias, which"),
        (MERGED + HEAD + "custom_data: *z17}", "it has an alias, which"),
    ],
)
def test_no_metadata(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=f"^{reason.replace('[', '.')}"):
        from_yaml(text)


def test_a_topic_takes_the_library_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """With thousands of topics, calls of the YAML library would take tens of seconds, for each new file of a
    bag.
    """
    calls = 0

    def count(value: object, *, dump: Callable[[object], str] = metadata._dump) -> str:
        nonlocal calls
        calls += 1
        return dump(value)

    names = ["/odd\n'x: []", "/ä", "/1", "", "/_x", *(f"/a/topic_{number}" for number in range(50))]
    named = [msgspec.structs.replace(CHATTER, name=name) for name in names]
    bag = msgspec.structs.replace(
        BAG, topics=tuple(TopicInformation(one, number) for number, one in enumerate(named))
    )
    text = metadata._dump(metadata.as_map(bag))
    for kept in (metadata._topic_text, metadata.profiles_to_text):
        kept.cache_clear()
    monkeypatch.setattr(metadata, "_dump", count)
    assert to_record(bag) == text
    assert from_yaml(to_yaml(bag)) == bag
    assert calls == 5 + 2 + 1  # names with quotes, the rest of each text, the profiles

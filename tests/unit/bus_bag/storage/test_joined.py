"""Several bags that are read as one: topics, QoS, the order of messages, topics that don't fit."""

from pathlib import Path

import pytest

from bags import CHATTER, LATCHED, Said, read, said, text_of, write_bag
from bus.qos import QoSProfile
from bus_bag.errors import BagError
from bus_bag.metadata import TopicMetadata
from bus_bag.storage import BagWriter, JoinedBags, open_bags


def joined(bags: JoinedBags, **options: object) -> list[Said]:
    return [
        Said(one.log_time, one.publish_time, one.sequence, one.topic, text_of(one.data))
        for one in bags.messages(**options)  # type: ignore[arg-type]
    ]


def bag_of(folder: Path, topic: TopicMetadata, definition: str = "string data\n") -> Path:
    writer = BagWriter(folder)
    writer.add_topic(topic, definition, {"busd.type_hash": folder.name})
    writer.close()
    return folder


def test_messages_of_all_bags_in_the_order_of_time(tmp_path: Path) -> None:
    messages = said(90)
    paths = [write_bag(tmp_path / str(number), messages[number::3]) for number in range(3)]
    with open_bags(paths) as bags:
        assert joined(bags) == messages
        assert joined(bags, by="publish_time") == messages
        assert joined(bags, start=messages[40].log_time) == messages[40:]
        assert joined(bags, topics=[LATCHED.name]) == messages[::3]
        assert (bags.starting_time, bags.duration) == (messages[0].log_time, 89_000_000)
        assert bags.message_count == 90
        assert list(bags.topics) == [CHATTER.name, LATCHED.name]
        assert bags.definition_of(CHATTER.name) == "string data\n"
        assert bags.problems == []


def test_an_empty_bag_changes_no_times(tmp_path: Path) -> None:
    messages = said(3)
    with open_bags([write_bag(tmp_path / "empty", []), write_bag(tmp_path / "full", messages)]) as bags:
        assert (bags.starting_time, bags.duration) == (messages[0].log_time, 2_000_000)
        assert joined(bags) == messages


def test_parts_of_a_recording_have_its_qos(tmp_path: Path) -> None:
    other = QoSProfile(3, reliability="best_effort")
    paths = [bag_of(tmp_path / str(number), LATCHED) for number in range(3)]
    paths.append(bag_of(tmp_path / "other", TopicMetadata(LATCHED.name, LATCHED.type, "cdr", (other,), "")))
    with open_bags(paths) as bags:
        assert bags.topics[LATCHED.name].offered_qos_profiles == (*LATCHED.offered_qos_profiles, other)
        assert bags.topics[LATCHED.name].type_description_hash == LATCHED.type_description_hash
        assert bags.extra_of(LATCHED.name) == {"busd.type_hash": "0"}


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        (TopicMetadata(CHATTER.name, "std_msgs/msg/Int64", "cdr", (), ""), "std_msgs/msg/Int64"),
        (
            TopicMetadata(CHATTER.name, CHATTER.type, "cdr", (), "RIHS01_0"),
            "another std_msgs/msg/String",
        ),
    ],
)
def test_a_topic_with_another_type_is_left_out(tmp_path: Path, other: TopicMetadata, kind: str) -> None:
    first = write_bag(tmp_path / "first", said(5))
    second = bag_of(tmp_path / "second", other, "int64 data\n")
    with open_bags([first, second]) as bags:
        assert [str(one) for one in bags.problems] == [
            f"{second}: topic '/chatter' is {kind} here and std_msgs/msg/String before; left out"
        ]
        assert bags.topics[CHATTER.name].type == CHATTER.type
        assert len(list(bags.messages())) == 5


def test_equal_names_of_types_with_other_definitions_on_two_topics(tmp_path: Path) -> None:
    first = write_bag(tmp_path / "first", said(1))
    other = TopicMetadata("/other", CHATTER.type, "cdr", (), "RIHS01_0")
    with open_bags([first, bag_of(tmp_path / "second", other, "int64 data\n")]) as bags:
        assert bags.definition_of("/other") == "int64 data\n"
        assert bags.definition_of(CHATTER.name) == "string data\n"


def test_a_missing_bag_closes_the_others(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", said(1))
    with pytest.raises(BagError, match=r"Bag path '.*/nowhere' does not exist!"):
        open_bags([bag, tmp_path / "nowhere"])
    with open_bags([bag]) as bags, open_bags([bag]) as again:
        assert read(bags.readers[0]) == joined(again)

"""The gaps that the storages find by their indexes."""

from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bags import CHATTER, LATCHED, START, Said, begin_bag, cdr, said, write, write_bag
from bus_bag.storage import Stretch, open_bags

S = 1_000_000_000
OFFSETS = (0, 1, 2, 100, 101, 300)
GAPS = [Stretch(START + 2 * S, START + 100 * S), Stretch(START + 101 * S, START + 300 * S)]


def at(*seconds: int, topic: str = CHATTER.name) -> list[Said]:
    return [
        Said(START + second * S, START + 2 * second * S, number, topic, "")
        for number, second in enumerate(seconds)
    ]


def test_in_one_chunk_and_in_several_files(tmp_path: Path) -> None:
    for name, files in {"one": [at(*OFFSETS)], "three": [at(0, 1), at(2, 100), at(101, 300)]}.items():
        with open_bags([write_bag(tmp_path / name, *files)]) as bags:
            assert bags.gaps(60 * S, [CHATTER.name]) == GAPS
            assert bags.gaps(98 * S, [CHATTER.name]) == GAPS[1:]
            assert bags.gaps(199 * S, [CHATTER.name]) == []


def test_by_publish_time(tmp_path: Path) -> None:
    with open_bags([write_bag(tmp_path / "bag", at(*OFFSETS))]) as bags:
        assert bags.gaps(60 * S, [CHATTER.name], "publish_time") == [
            Stretch(START + 4 * S, START + 200 * S),
            Stretch(START + 202 * S, START + 600 * S),
        ]


def test_only_the_chosen_topics_count(tmp_path: Path) -> None:
    messages = sorted([*at(*OFFSETS), *at(*range(0, 300, 10), topic=LATCHED.name)])
    with open_bags([write_bag(tmp_path / "bag", messages)]) as bags:
        assert bags.gaps(60 * S, [CHATTER.name]) == GAPS
        assert bags.gaps(60 * S, [CHATTER.name, LATCHED.name]) == []


def test_a_file_without_an_index(tmp_path: Path) -> None:
    writer, channels = begin_bag(tmp_path / "cut")
    write(writer, channels, at(*OFFSETS))
    writer.close()
    (path,) = (tmp_path / "cut").glob("*.mcap")
    path.write_bytes(path.read_bytes()[:-30])
    with open_bags([path]) as bags:
        assert not bags.readers[0].files[0].has_index
        assert bags.gaps(60 * S, [CHATTER.name]) == GAPS


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_of_bags_that_rosbags_wrote(tmp_path: Path, plugin: StoragePlugin) -> None:
    types = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "walk", version=9, storage_plugin=plugin) as writer:
        connections = [
            writer.add_connection(name, CHATTER.type, typestore=types) for name in (CHATTER.name, "/other")
        ]
        for second in range(301):
            writer.write(connections[second not in OFFSETS], START + second * S, cdr(""))
    with open_bags([tmp_path / "walk"]) as bags:
        assert bags.gaps(60 * S, [CHATTER.name]) == GAPS
        assert bags.gaps(60 * S, [CHATTER.name, "/other"]) == []
        assert bags.gaps(0, []) == []


def test_a_dense_bag_has_none(tmp_path: Path) -> None:
    with open_bags([write_bag(tmp_path / "bag", said(3000, length=800))]) as bags:
        assert bags.gaps(S, bags.topics) == []

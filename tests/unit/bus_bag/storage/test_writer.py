"""Bags that busd writes, read by busd and by other readers: mcap, rosbags and mcap-ros2."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

pytest.importorskip("mcap")
pytest.importorskip("mcap_ros2")
pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from bags import CHATTER, LATCHED, START, STRING, begin_bag, read, said, text_of, write, write_bag
from bus_bag.errors import BagError
from bus_bag.metadata import from_record
from bus_bag.storage import open_bag
from bus_bag.storage.mcap_writer import PRESETS


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("length", [0, 40_000])
def test_others_read_it(tmp_path: Path, preset: str, length: int) -> None:
    messages = said(300, length=length)
    folder = write_bag(tmp_path / "walk", messages[:200], messages[200:], preset=preset)
    assert sorted(path.name for path in folder.iterdir()) == ["metadata.yaml", "walk_0.mcap", "walk_1.mcap"]
    with open_bag(folder) as reader:
        assert read(reader) == messages
        assert reader.problems == []
    with AnyReader([folder]) as others:
        found = [(time, text_of(raw), connection.topic) for connection, time, raw in others.messages()]
        assert found == [(one.log_time, one.text, one.topic) for one in messages]
        assert {one.topic: len(one.ext.offered_qos_profiles) for one in others.connections} == {
            CHATTER.name: 1,
            LATCHED.name: 2,
        }
    texts = []
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as stream:
            judge = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            texts += [one.decoded_message.data for one in judge.iter_decoded_messages()]
        with path.open("rb") as stream:
            assert list(StreamReader(stream, validate_crcs=True).records)
    assert texts == [one.text for one in messages]


def test_what_a_file_says(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", said(3))
    with (folder / "walk_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        records = [(one.name, one.metadata) for one in reader.iter_metadata()]
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.channel_message_counts == {0: 1, 1: 2} or summary.statistics.message_count == 3
    assert {one.name: (one.encoding, one.data) for one in summary.schemas.values()} == {
        STRING: ("ros2msg", b"string data\n")
    }
    channel = next(one for one in summary.channels.values() if one.topic == CHATTER.name)
    assert channel.message_encoding == "cdr"
    assert list(channel.metadata) == ["offered_qos_profiles", "topic_type_hash", "busd.type_hash"]
    assert [one["history"] for one in yaml.safe_load(channel.metadata["offered_qos_profiles"])] == [
        "keep_last"
    ]
    assert [name for name, _ in records] == ["rosbag2", "rosbag2"]
    empty, full = (from_record(texts["serialized_metadata"]) for _, texts in records)
    assert (empty.message_count, full.message_count) == (0, 3)
    assert full.starting_time == START
    assert full.files[0].path == "walk_0.mcap"


def test_jobs_of_another_thread(tmp_path: Path) -> None:
    """No file changes before its job runs. Everything else is known at once."""
    jobs: list[Callable[[], None]] = []
    writer, channels = begin_bag(tmp_path / "walk", run=lambda job, size: jobs.append(job))
    size = writer.size
    write(writer, channels, said(10))
    writer.close()
    assert writer.size == size
    assert writer.counts() == {CHATTER.name: 0, LATCHED.name: 0}
    for job in jobs:
        job()
    assert writer.size == (tmp_path / "walk" / "walk_0.mcap").stat().st_size
    assert writer.counts() == {CHATTER.name: 6, LATCHED.name: 4}
    assert writer.metadata().message_count == 10


def test_messages_of_a_topic_that_is_not_in_the_file(tmp_path: Path) -> None:
    """If the job that describes the topic was dropped, the writer drops its messages too: no reader could
    decode them.
    """
    jobs: list[Callable[[], None]] = []
    writer, channels = begin_bag(tmp_path / "walk", run=lambda job, size: jobs.append(job))
    write(writer, channels, said(10))
    writer.close()
    for job in jobs[2:]:
        job()
    assert writer.counts() == {CHATTER.name: 0, LATCHED.name: 0}
    with open_bag(tmp_path / "walk") as reader:
        assert (read(reader), reader.problems) == ([], [])


def test_a_bag_without_messages(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", [])
    with open_bag(folder) as reader:
        assert (read(reader), reader.problems, reader.metadata.duration) == ([], [], 0)
        assert list(reader.topics) == [CHATTER.name, LATCHED.name]
    with AnyReader([folder]) as others:
        assert others.message_count == 0


def test_without_mcap_no_folder_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.records", None)
    with pytest.raises(BagError, match="bags need the package mcap: pip install 'mcap"):
        begin_bag(tmp_path / "walk")
    assert not (tmp_path / "walk").exists()


def test_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"^Output folder '.*/there' already exists\.$"):
        (tmp_path / "there").mkdir()
        begin_bag(tmp_path / "there")
    with pytest.raises(
        BagError, match=r"valid options are 'none', 'fastwrite', 'zstd_fast', 'zstd_small'\): fast$"
    ):
        begin_bag(tmp_path / "walk", preset="fast")
    assert not (tmp_path / "walk").exists()

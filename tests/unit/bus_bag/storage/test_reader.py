"""Bags from other programs, complete or not, and folders that are no bags."""

import os
import sqlite3
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.rosbag2 import CompressionMode, StoragePlugin

from bags import CHATTER, START, STRING, STRING_HASH, begin_bag, cdr, read, said, write, write_bag
from bus.qos import QoSProfile
from bus_bag.errors import BagError
from bus_bag.storage import open_bag
from rosbags_writer import write_as_rosbags


@pytest.mark.parametrize("plugin", StoragePlugin)
@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("mode", CompressionMode)
def test_what_rosbags_writes(
    tmp_path: Path, plugin: StoragePlugin, version: int, mode: CompressionMode
) -> None:
    if (plugin, mode) == (StoragePlugin.SQLITE3, CompressionMode.STORAGE):
        return  # SQLite has no compression by the storage
    messages = write_as_rosbags(tmp_path / "walk", plugin, version, mode)
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == messages
        assert reader.problems == []
        assert reader.metadata.message_count == len(messages)
        assert reader.metadata.version == version
        assert reader.metadata.storage_identifier == plugin.name.lower()
        topic = reader.topics[CHATTER.name]
        assert (topic.type, topic.type_description_hash) == (STRING, STRING_HASH)
        assert topic.offered_qos_profiles == (
            QoSProfile(3, reliability="best_effort", durability="transient_local", lifespan=10.5),
        )
        assert reader.definitions[STRING].strip() == "string data"
        assert read(reader, start=START + 40) == messages[40:]
        assert read(reader, topics=[]) == []


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_a_lone_file(tmp_path: Path, plugin: StoragePlugin) -> None:
    messages = write_as_rosbags(tmp_path / "walk", plugin)
    (file,) = (path for path in (tmp_path / "walk").iterdir() if path.suffix != ".yaml")
    with open_bag(file) as reader:
        assert read(reader) == messages
    renamed = file.rename(file.with_suffix(".bag"))
    with open_bag(renamed) as reader:
        assert read(reader) == messages


def test_an_old_database(tmp_path: Path) -> None:
    """A database as ROS 2 Foxy made it: without hashes, definitions and an index of timestamps."""
    path = tmp_path / "old_0.db3"
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        f"INSERT INTO topics VALUES(1, '/chatter', '{STRING}', 'cdr');"
    )
    rows = [(START + 2, cdr("b")), (START + 1, cdr("a")), ("soon", cdr("c")), (START + 3, None)]
    database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", rows)
    database.commit()
    database.close()
    with open_bag(tmp_path) as reader:
        assert [one.text for one in read(reader)] == ["a", "b"]
        assert [problem.text for problem in reader.problems] == [
            "it is missing; the bag's files are read instead",
            "2 rows are skipped: no message of a topic",
        ]
        assert reader.definitions == {}


def test_times_and_topics(tmp_path: Path) -> None:
    messages = said(3000, length=1000)
    folder = write_bag(tmp_path / "walk", messages[:1000], messages[1000:1500], messages[1500:])
    with open_bag(folder) as reader:
        for first in (0, 1, 999, 1000, 1700, 2999):
            assert read(reader, start=messages[first].log_time) == messages[first:]
        assert read(reader, start=messages[-1].log_time + 1) == []
        assert read(reader, topics=[CHATTER.name]) == [one for one in messages if one.topic == CHATTER.name]
        assert read(reader, topics=["/nobody"]) == []


def test_the_order_of_publishing(tmp_path: Path) -> None:
    """A recorder gets latched messages long after they were published."""
    messages = said(2000, length=2000)
    late = [
        messages[900]._replace(publish_time=START - 5000),
        messages[10]._replace(publish_time=START - 9000),
    ]
    writer, channels = begin_bag(tmp_path / "walk")
    written = [*messages[:10], late[1], *messages[11:900], late[0], *messages[901:]]
    write(writer, channels, written[:1000])
    writer.split()
    write(writer, channels, written[1000:])
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == written
        found = read(reader, by="publish_time")
        assert found == sorted(written, key=lambda one: one.publish_time)
        assert found[:2] == [late[1], late[0]]
        start = messages[500].publish_time
        assert read(reader, by="publish_time", start=start) == [
            one for one in written if one.publish_time >= start
        ]


def test_messages_that_were_written_late(tmp_path: Path) -> None:
    """Chunks overlap in one file and in two. The reader still returns their messages in order."""
    messages = said(900, length=4000)
    folder = write_bag(tmp_path / "walk", messages[::2], messages[1::2])
    mixed = [*messages[600:], *messages[:600]]
    other = write_bag(tmp_path / "mixed", mixed)
    for path in (folder, other):
        with open_bag(path) as reader:
            assert read(reader) == messages
            assert read(reader, start=messages[300].log_time) == messages[300:]


def test_no_bags(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "junk").mkdir()
    for name in ("a.txt", "b.mcap", "c.db3", "d.mcap.zstd"):
        (tmp_path / "junk" / name).write_bytes(b"junk that is long enough for a header of any kind" * 9)
    (tmp_path / "nothing.mcap").touch()
    (tmp_path / "metadata.yaml").write_text("[1")
    database = sqlite3.connect(tmp_path / "other.db3")
    database.execute("CREATE TABLE messages(id INTEGER)")
    database.close()
    texts = {
        "nowhere": "Bag path '{}' does not exist!",
        "empty": "'{}' is not a bag: there is neither a metadata.yaml nor a file .mcap or .db3 in it",
        "junk": "'{}/b.mcap' is not an MCAP file: its first bytes are different",
        "junk/c.db3": "'{}' is not an SQLite file: its first bytes are different",
        "junk/d.mcap.zstd": "'{}' can't be unpacked: ",
        "junk/a.txt": "'{}' is not an MCAP file: its first bytes are different",
        "nothing.mcap": "'{}' is empty",
        "other.db3": "'{}' is not a bag: the tables 'topics' and 'messages' are not in it",
    }
    for name, text in texts.items():
        with pytest.raises(BagError) as refused:
            open_bag(tmp_path / name)
        assert str(refused.value).startswith(
            text.format(tmp_path / name.split("/")[0] if name == "junk" else tmp_path / name)
        )


def test_what_is_no_file(tmp_path: Path) -> None:
    """Opening a pipe would wait for its other end."""
    folder = write_bag(tmp_path / "walk", said(3))
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(BagError, match=r"^'.*/pipe.mcap' is not a file$"):
        open_bag(tmp_path / "pipe.mcap")
    (folder / "metadata.yaml").unlink()
    os.mkfifo(folder / "metadata.yaml")
    os.mkfifo(folder / "walk_1.mcap")
    with open_bag(folder) as reader:
        assert read(reader) == said(3)
        assert [problem.text for problem in reader.problems] == ["it can't be used: it is not a file"]


def test_a_name_that_no_file_can_have(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", said(3))
    text = (folder / "metadata.yaml").read_text()
    for name in ("a\\0.mcap", "a\\0.db3", "a\\0.mcap.zstd"):
        (folder / "metadata.yaml").write_text(text.replace("- walk_0.mcap", f'- "{name}"'))
        with pytest.raises(BagError, match=r"^no file can have the path '.*a.x00.*'$"):
            open_bag(folder)


def test_the_package_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence names the extra. SQLite files are readable without it."""
    folder = write_bag(tmp_path / "walk", said(3))
    messages = write_as_rosbags(tmp_path / "other")
    for name in [name for name in sys.modules if name.partition(".")[0] == "mcap"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if "site-packages" not in path])
    text = r"^bags need the package mcap: pip install 'mcap>=1.3,<2'$"
    with pytest.raises(BagError, match=text):
        open_bag(folder)
    with pytest.raises(BagError, match=text):
        write_bag(tmp_path / "new", [])
    with open_bag(tmp_path / "other") as reader:
        assert read(reader) == messages


def test_a_file_is_missing(tmp_path: Path) -> None:
    messages = said(30)
    folder = write_bag(tmp_path / "walk", messages[:10], messages[10:20], messages[20:])
    (folder / "walk_1.mcap").unlink()
    with open_bag(folder) as reader:
        assert read(reader) == [*messages[:10], *messages[20:]]
        (problem,) = reader.problems
        assert problem.path.endswith("walk_1.mcap")

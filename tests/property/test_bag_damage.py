"""Bags that were cut off or changed anywhere: intact parts are read, and each error is one sentence."""

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from bags import Said, begin_bag, cdr, read, said, write
from bus_bag.errors import BagError
from bus_bag.storage import open_bag
from bus_bag.storage.mcap_reader import McapFile
from bus_bag.storage.rewriting import rewrite

MESSAGES = [*said(60, length=50), *said(3, first=60, length=20_000), *said(60, first=63, length=50)]
"""In six chunks; the middle ones have no CRC."""
PRESETS = ("none", "fastwrite", "zstd_fast")


@cache
def bag(preset: str) -> tuple[bytes, tuple[tuple[int, int], ...]]:
    """A file; and pairs: an offset, and the number of messages that must be readable up to it."""
    with tempfile.TemporaryDirectory() as folder:
        writer, channels = begin_bag(Path(folder) / "walk", preset=preset)
        whole = [(0, 0)]
        for first in range(0, len(MESSAGES), 21):
            write(writer, channels, MESSAGES[first : first + 21])
            writer.flush()
            whole.append((writer.size, min(first + 21, len(MESSAGES))))
        writer.close()
        return (Path(folder) / "walk" / "walk_0.mcap").read_bytes(), tuple(whole)


@cache
def database() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.db3"
        bag = sqlite3.connect(path)
        bag.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
            "INSERT INTO topics VALUES(1, '/chatter', 'std_msgs/msg/String', 'cdr', '- history: 1');"
        )
        rows = [(one.log_time, cdr(one.text)) for one in MESSAGES]
        bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", rows)
        bag.commit()
        bag.close()
        return path.read_bytes()


@contextmanager
def file_of(data: bytes, name: str = "walk_0.mcap") -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        yield path


def read_all(path: Path) -> list[Said] | None:
    """All messages; None if the bag is refused with one sentence."""
    try:
        with open_bag(path) as reader:
            found = [one for one in reader.messages() if len(one.data) >= 9]
            for one in reader.messages(by="publish_time", start=MESSAGES[40].log_time):
                assert one.publish_time >= MESSAGES[40].log_time
            assert all(str(one).count("\n") == 0 for one in reader.problems)
            return [
                Said(
                    one.log_time,
                    one.publish_time,
                    one.sequence,
                    one.topic,
                    bytes(one.data[8:-1]).decode("latin1"),
                )
                for one in found
            ]
    except BagError as error:
        assert "\n" not in str(error)
        return None


@given(preset=st.sampled_from(PRESETS), cut=st.floats(0, 1))
def test_cut_off_anywhere(preset: str, cut: float) -> None:
    """Everything up to the last intact chunk is read; the same after a repair."""
    data, whole = bag(preset)
    size = round(cut * (len(data) - 1))
    least = max(count for end, count in whole if end <= size)
    with file_of(data[:size]) as path:
        found = read_all(path)
        if found is None:
            assert size < 8
            return
        assert found == MESSAGES[: len(found)]
        assert len(found) >= least
        file = McapFile(path)
        assert file.is_cut
        metadata = open_bag(path).metadata
        assert metadata.message_count == len(found)
        rewrite(file, metadata)
        with open_bag(path) as reader:
            assert (read(reader), reader.problems) == (found, [])


@given(
    preset=st.sampled_from(PRESETS),
    flips=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 7)), min_size=1, max_size=4),
    cut=st.floats(0, 1) | st.just(1.0),
)
def test_bits_flipped_anywhere(preset: str, flips: list[tuple[float, int]], cut: float) -> None:
    data = bytearray(bag(preset)[0])
    for place, bit in flips:
        data[round(place * (len(data) - 1))] ^= 1 << bit
    with file_of(bytes(data[: round(cut * len(data))])) as path:
        read_all(path)


@given(
    flips=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 7)), max_size=4),
    cut=st.floats(0, 1) | st.just(1.0),
)
def test_databases(flips: list[tuple[float, int]], cut: float) -> None:
    data = bytearray(database())
    for place, bit in flips:
        data[round(place * (len(data) - 1))] ^= 1 << bit
    with file_of(bytes(data[: round(cut * len(data))]), "walk_0.db3") as path:
        read_all(path)


@given(st.binary(max_size=300))
def test_junk_behind_the_magic(junk: bytes) -> None:
    for head in (b"\x89MCAP0\r\n", b"SQLite format 3\0", b""):
        for name in ("walk_0.mcap", "walk_0.db3", "walk_0.mcap.zstd", "metadata.yaml"):
            with file_of(head + junk, name) as path:
                read_all(path.parent)

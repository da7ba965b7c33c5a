"""MCAP files that are damaged, come from other programs, or are made to do harm."""

import os
import resource
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from mcap.writer import CompressionType, IndexType, Writer

from bags import CHATTER, START, STRING, Said, begin_bag, cdr, read, said, write, write_bag
from bus_bag.errors import BagError
from bus_bag.storage import open_bag
from bus_bag.storage.mcap_format import MAGIC, MESSAGE, RECORD, Opcode
from bus_bag.storage.mcap_reader import McapFile
from rows import for_each


def chunks_of(path: Path) -> list[int]:
    """The offsets of the chunks, from the file's index."""
    file = McapFile(path)
    file.close()
    return [segment.offset for segment in file._segments]


def test_a_chunk_is_damaged(tmp_path: Path) -> None:
    """The reader skips and names the damaged chunk. It returns all messages before and behind it."""
    messages = said(4000, length=800)
    for preset in ("none", "zstd_fast"):
        folder = write_bag(tmp_path / preset, messages, preset=preset)
        path = folder / f"{preset}_0.mcap"
        data = bytearray(path.read_bytes())
        _, second, third = chunks_of(path)[:3] if preset == "none" else (0, *chunks_of(path)[1:3])
        data[(second + third) // 2] ^= 0x10
        path.write_bytes(data)
        with open_bag(folder) as reader:
            assert reader.problems == []
            found = read(reader)
            (problem,) = reader.problems
        lost = [one for one in messages if one not in found]
        assert 0 < len(lost) < 2000
        assert found == messages[: lost[0].sequence] + messages[lost[-1].sequence + 1 :]
        assert problem.offset == second
        assert problem.text.startswith(f"a chunk with {len(lost)} messages is skipped: ")


def test_an_index_is_damaged(tmp_path: Path) -> None:
    """The reader goes through the whole file, and nothing is missing."""
    messages = said(3000, length=800)
    folder = write_bag(tmp_path / "walk", messages)
    path = folder / "walk_0.mcap"
    data = bytearray(path.read_bytes())
    data[-200] ^= 1
    path.write_bytes(data)
    with open_bag(folder) as reader:
        assert read(reader) == messages
        assert [problem.text for problem in reader.problems] == ["its index is damaged: its CRC is wrong"]
        assert not reader.is_cut


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("indexes", [IndexType.ALL, IndexType.NONE, IndexType.CHUNK])
@pytest.mark.parametrize("use_chunking", [True, False])
def test_what_mcap_writes(
    tmp_path: Path, compression: CompressionType, indexes: IndexType, use_chunking: bool
) -> None:
    """mcap writes types and topics into the chunks. The test reads the file complete, and cut off so that
    only the chunks describe it.
    """
    messages = [
        Said(START + number, START + number, number, CHATTER.name, f"{number}") for number in range(500)
    ]
    path = tmp_path / "other.mcap"
    writer = Writer(
        str(path),
        chunk_size=4000,
        compression=compression,
        index_types=indexes,
        use_chunking=use_chunking,
        use_statistics=indexes is IndexType.ALL,
    )
    writer.start("ros2", "other")
    schema = writer.register_schema(STRING, "ros2msg", b"string data\n")
    channel = writer.register_channel(CHATTER.name, "cdr", schema, {"offered_qos_profiles": "- history: 3"})
    writer.add_attachment(START, START, "map", "image/png", b"a picture")
    for one in messages:
        writer.add_message(channel, one.log_time, cdr(one.text), one.publish_time, one.sequence)
    writer.finish()
    with open_bag(path) as reader:
        assert read(reader) == messages
        assert read(reader, start=START + 100) == messages[100:]
        assert (reader.problems, reader.metadata.message_count) == ([], 500)
        assert reader.topics[CHATTER.name].type == STRING
    path.write_bytes(path.read_bytes()[:-20])
    with open_bag(path) as reader:
        assert read(reader) == messages
        assert reader.is_cut
        assert reader.metadata.message_count == 500
        assert len(reader.problems) == 1


def test_topics_of_two_types(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    writer = Writer(str(path))
    writer.start("ros2", "other")
    for number, name in enumerate((STRING, "std_msgs/msg/Header")):
        schema = writer.register_schema(name, "ros2msg", b"string data\n")
        channel = writer.register_channel(CHATTER.name, "cdr", schema)
        writer.add_message(channel, START + number, cdr(name), START)
    writer.finish()
    with open_bag(path) as reader:
        assert [one.text for one in read(reader)] == [STRING]
        (problem,) = reader.problems
    assert problem.text == (
        "topic '/chatter' has types std_msgs/msg/String and std_msgs/msg/Header; only the first is read"
    )


HUGE = 2**63 - 1


def record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    return RECORD.pack(opcode, len(content) if length is None else length) + content


def chunk(compression: str, size: int, data: bytes, stored: int | None = None) -> bytes:
    name = compression.encode()
    head = START.to_bytes(8, "little") * 2 + size.to_bytes(8, "little") + bytes(4)
    stored_text = (len(data) if stored is None else stored).to_bytes(8, "little")
    return record(Opcode.CHUNK, head + len(name).to_bytes(4, "little") + name + stored_text + data)


def footer(start: int) -> bytes:
    return record(Opcode.FOOTER, start.to_bytes(8, "little") + bytes(12)) + MAGIC


def zstd_of(size: int) -> bytes:
    """The head of a zstd frame that claims `size` bytes."""
    return b"\x28\xb5\x2f\xfd\xe0" + size.to_bytes(8, "little") + b"\x01\x00\x00"


def indexed(data: bytes, *indexes: bytes) -> bytes:
    """Data with an index."""
    statistics = record(Opcode.STATISTICS, bytes(46))
    return data + b"".join(indexes) + statistics + footer(len(MAGIC) + len(data))


def metadata_index(offset: int) -> bytes:
    return record(Opcode.METADATA_INDEX, offset.to_bytes(8, "little") + bytes(12))


def chunk_index(offset: int, length: int) -> bytes:
    times = START.to_bytes(8, "little") * 2
    return record(
        Opcode.CHUNK_INDEX, times + offset.to_bytes(8, "little") + length.to_bytes(8, "little") + bytes(4)
    )


def metadata_within(count: int) -> bytes:
    """Heads of metadata records, one after the other, which end all at the same place."""
    end = 9 * count + 20_000
    heads = (record(Opcode.METADATA, b"", end - 9 * number) for number in range(1, count + 1))
    return b"".join(heads) + bytes(20_000)


LONG = (1 << 20).to_bytes(4, "little") + b"x" * (1 << 20)
HOSTILE = {
    "nothing but the magic": b"",
    "a record without an end": record(Opcode.SCHEMA, b"", HUGE),
    "a schema of gigabytes": record(Opcode.SCHEMA, b"\1\0\xff\xff\xff\xff"),
    "a channel of nothing": record(Opcode.CHANNEL, b""),
    "metadata that never end": record(Opcode.METADATA, bytes(4) + b"\xff\xff\xff\xff"),
    "a chunk that unpacks to exabytes": chunk("zstd", HUGE, zstd_of(HUGE)),
    "a chunk that lies about its size": chunk("zstd", 1000, zstd_of(HUGE)),
    "a chunk of an unknown kind": chunk("brotli", 10, bytes(10)),
    "a chunk longer than its record": chunk("", 10, bytes(10), HUGE),
    "a chunk of lz4 that is none": chunk("lz4", 1 << 20, bytes(100)),
    "a chunk with a message of exabytes": chunk("", 31, MESSAGE.pack(5, HUGE, 1, 0, 0, 0)),
    "a message that is too short": record(Opcode.MESSAGE, bytes(10)),
    "a message of nobody's channel": record(Opcode.MESSAGE, bytes(30)),
    "an index that is the whole file": footer(8),
    "an index beyond the file": footer(HUGE),
    "an index of junk": record(Opcode.CHUNK_INDEX, bytes(9)) + footer(8),
    "a metadata index beyond the file": record(Opcode.METADATA_INDEX, HUGE.to_bytes(8, "little") + bytes(12))
    + footer(8),
    "statistics with too many counts": record(Opcode.STATISTICS, bytes(42) + b"\xff\xff\xff\xff") + footer(8),
    "zeros": bytes(5000),
    "one metadata record many times": indexed(
        record(Opcode.METADATA, LONG + bytes(4)), *[metadata_index(len(MAGIC))] * 300
    ),
    "metadata records within others": indexed(
        metadata_within(200), *(metadata_index(len(MAGIC) + 9 * number) for number in range(200))
    ),
    "many chunks before the same message indexes": indexed(
        bytes(300) + record(Opcode.MESSAGE_INDEX, bytes(6)) * 500,
        *(chunk_index(len(MAGIC) + number, 300 - number) for number in range(300)),
    ),
}


@for_each("name", HOSTILE)
def test_hostile_files(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The result is an empty bag or an error of one line, with few bytes read and little memory."""
    path = tmp_path / "hostile.mcap"
    path.write_bytes(MAGIC + HOSTILE[name])
    read_sizes = []
    pread = os.pread

    def counting(descriptor: int, size: int, offset: int) -> bytes:
        data = pread(descriptor, size, offset)
        read_sizes.append(len(data))
        return data

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with monkeypatch.context() as patched:
        patched.setattr("os.pread", counting)
        try:
            with open_bag(path) as reader:
                assert read(reader) == []
                assert read(reader, by="publish_time") == []
                assert all("\n" not in str(problem) for problem in reader.problems)
        except BagError as error:
            assert "\n" not in str(error)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < most + 100_000  # KiB
    assert len(read_sizes) < 70_000
    assert sum(read_sizes) < 10 * path.stat().st_size + (2 << 20)


def test_chunks_that_overlap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More chunks overlap than fit into memory. The reader reads them again at the time of their messages."""
    monkeypatch.setattr("bus_bag.storage.mcap_bytes._LOADED", 4 << 20)
    messages = said(240, length=200_000)
    writer, channels = begin_bag(tmp_path / "walk")
    shuffled = [one for first in range(3) for one in messages[first::3]]
    write(writer, channels, shuffled)
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        times = [one.log_time for one in reader.messages()]
        assert times == [one.log_time for one in messages]
        file = reader.files[0]
        assert isinstance(file, McapFile)
        assert file._loaded_size <= 4 << 20
        assert file._waiting == 0


def test_more_messages_overlap_than_can_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file may unpack to very many messages."""
    monkeypatch.setattr("bus_bag.storage.mcap_reader._MOST_WAITING", 50)
    messages = said(60)
    writer, channels = begin_bag(tmp_path / "walk")
    for first in range(2):
        write(writer, channels, messages[first::2])
        writer.flush()
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == messages[::2]
        (problem,) = reader.problems
        assert problem.text == "30 messages are skipped: too many overlap in time"

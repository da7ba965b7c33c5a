"""Files without room for more: the written part is a complete bag all the same."""

import errno
import os
import resource
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from bags import begin_bag, read, said, write
from bus_bag.errors import BagFull
from bus_bag.storage import BagWriter, open_bag
from bus_bag.storage.reserve import Reserve


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Limit the size of files that this process writes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


class Disk:
    """A disk with room for `size` bytes, including the reserve."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
        self.size = size
        self.reserved = 0
        self._writev = os.writev
        monkeypatch.setattr("os.writev", self.writev)
        monkeypatch.setattr(Reserve, "hold", lambda _, size: self.hold(size))
        monkeypatch.setattr(Reserve, "give_back", lambda _: self.give_back())
        monkeypatch.setattr(Reserve, "size", property(lambda _: self.reserved))

    def hold(self, size: int) -> None:
        self.reserved = max(self.reserved, 20_000)

    def give_back(self) -> bool:
        had, self.reserved = self.reserved, 0
        return had > 0

    def writev(self, descriptor: int, pieces: Sequence[bytes]) -> int:
        taken = os.fstat(descriptor).st_size + sum(map(len, pieces))
        if taken + self.reserved > self.size:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._writev(descriptor, pieces)


def fill(writer: BagWriter, channels: dict[str, int], count: int) -> str:
    """Write until nothing more fits, and close. Returns the text of the error."""
    with pytest.raises(BagFull) as full:
        for one in said(count, length=900):
            write(writer, channels, [one])
            if one.sequence % 10 == 9:
                writer.flush()
    write(writer, channels, said(3))  # the writer loses these, too
    writer.write_metadata("busd.losses", {"/chatter": "{}"})
    writer.close()
    return str(full.value)


def check(folder: Path, writer: BagWriter) -> int:
    """Check that every reader finds a complete bag. Returns its number of messages."""
    with open_bag(folder) as reader:
        messages = read(reader)
        assert (reader.problems, reader.is_cut) == ([], False)
        assert [name for name, _ in reader.files[0].records] == ["rosbag2", "busd.losses", "rosbag2"]
        assert reader.metadata.message_count == len(messages)
    assert messages == said(len(messages), length=900)
    assert sum(writer.counts().values()) == len(messages)
    with (folder / "walk_0.mcap").open("rb") as stream:
        assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == len(messages)
    with AnyReader([folder]) as others:
        assert others.message_count == len(messages)
    return len(messages)


@pytest.mark.parametrize("preset", ["none", "fastwrite", "zstd_fast"])
def test_a_file_may_not_be_larger(tmp_path: Path, preset: str) -> None:
    """The last chunks make room for the end of the file."""
    writer, channels = begin_bag(tmp_path / "walk", preset=preset)
    with largest_file(60_000):
        text = fill(writer, channels, 100_000)
    assert text.startswith(f"{tmp_path}/walk/walk_0.mcap can't grow beyond ")
    assert text.endswith(" bytes: File too large")
    assert check(tmp_path / "walk", writer) >= 30
    assert (tmp_path / "walk" / "walk_0.mcap").stat().st_size <= 60_000


def test_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reserve is enough for the end of the file, so the writer takes back nothing that it has written."""
    writer, channels = begin_bag(tmp_path / "walk")
    disk = Disk(monkeypatch, 60_000)
    text = fill(writer, channels, 100)
    assert text.endswith(" bytes: No space left on device")
    assert disk.reserved == 0
    count = check(tmp_path / "walk", writer)
    assert count == 30


def test_there_is_no_room_for_a_further_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer, channels = begin_bag(tmp_path / "walk")
    write(writer, channels, said(10, length=900))
    writer.flush()
    size = writer.size
    writev = os.writev

    def full(descriptor: int, pieces: Sequence[bytes]) -> int:
        if os.fstat(descriptor).st_size < size:
            raise OSError(errno.ENOSPC, "No space left on device")
        return writev(descriptor, pieces)

    monkeypatch.setattr("os.writev", full)
    with pytest.raises(BagFull):
        writer.split()
    write(writer, channels, said(1))
    writer.write_metadata("busd.losses", {})
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == said(10, length=900)
        assert [file.path for file in reader.metadata.files] == ["walk_0.mcap"]
    assert len(list((tmp_path / "walk").iterdir())) == 2


def test_a_write_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system may write only a part, and takes at most 1024 pieces at once."""
    writev = os.writev

    def little(descriptor: int, pieces: Sequence[bytes]) -> int:
        assert len(pieces) <= 1024
        return writev(descriptor, [bytes(pieces[0])[:777]] if len(pieces[0]) > 777 else pieces[:2])

    monkeypatch.setattr("os.writev", little)
    writer, channels = begin_bag(tmp_path / "walk")
    messages = said(2000, length=500) + said(5, first=2000, length=20_000)
    write(writer, channels, messages)
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == messages

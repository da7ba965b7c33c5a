"""A further storage, added as docs/architecture.md describes: files of lines, each of them JSON."""

import json
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from bags import read, said, write_bag
from bus_bag.convert import convert, read_outputs
from bus_bag.errors import BagError
from bus_bag.metadata import BagMetadata, TopicMetadata
from bus_bag.reindex import reindex
from bus_bag.storage import BagMessage, BagWriter, Order, Problem, open_bag, registry
from bus_bag.storage.bag_file import Buffer, Stamp, Summary
from bus_bag.storage.registry import (
    find_storage,
    register,
    storage_of,
    storages,
    suffix_list,
    writable_storage,
    writable_storages,
)
from bus_bag.storage.stretches import Stretch, split
from bus_cli.bag import playargs, record


class LinesFile:
    """A BagFile."""

    storage = "lines"
    has_index = is_cut = is_being_written = False

    def __init__(self, path: Path, content: Path) -> None:
        self.path = path
        self.topics: dict[str, TopicMetadata] = {}
        self.extra: dict[str, dict[str, str]] = {}
        self.definitions: dict[str, str] = {}
        self.problems: list[Problem] = []
        self.records: list[tuple[str, dict[str, str]]] = []
        self._messages: list[BagMessage] = []
        names: dict[int, str] = {}
        for number, kind, *rest in map(json.loads, content.read_text().splitlines()[1:]):
            if kind == "topic":
                names[number], type_name = rest
                self.topics[names[number]] = TopicMetadata(names[number], type_name, "cdr")
            else:
                log_time, publish_time, sequence, data = rest
                message = BagMessage(names[number], log_time, publish_time, sequence, bytes.fromhex(data))
                self._messages.append(message)
        times = [one.log_time for one in self._messages]
        counts = dict(Counter(one.topic for one in self._messages))
        self.summary = Summary(len(times), min(times, default=0), max(times, default=0), counts)

    def metadata(self) -> BagMetadata | None:
        return None

    def messages(self, start: int | None, topics: frozenset[str] | None, by: Order) -> Iterator[BagMessage]:
        chosen = [one for one in self._messages if topics is None or one.topic in topics]
        chosen.sort(key=lambda one: one.log_time if by == "log_time" else one.publish_time)
        return (one for one in chosen if one.log_time >= (start or 0))

    def stretches(self, least: int, topics: frozenset[str], by: Order) -> Iterator[Stretch]:
        return split((one.log_time for one in self.messages(None, topics, by)), least)

    def close(self) -> None:
        pass


class Lines(list[tuple[int, int, int, int, bytes]]):
    """A Gatherer, and its gathered messages."""

    size = 0

    def add(
        self, channel: int, log_time: int, publish_time: int, sequence: int, parts: Sequence[Buffer]
    ) -> int:
        data = b"".join(parts)
        self.append((channel, log_time, publish_time, sequence, data))
        self.size += len(data)
        return len(data)

    def add_many(self, channel: int, stamps: Sequence[Stamp], messages: Sequence[Buffer]) -> int:
        pairs = zip(stamps, messages, strict=True)
        return sum(self.add(channel, one[1], one[0], one[2], [message]) for one, message in pairs)

    def close(self) -> "Lines | None":
        gathered = Lines(self)
        gathered.size, self.size = self.size, 0
        self.clear()
        return gathered or None


class LinesWriter:
    """A BagFileWriter."""

    is_open = True
    starting_time = end_time = size = 0

    def __init__(self, path: Path) -> None:
        self.path = path
        self.counts: Counter[int] = Counter()
        self._names: dict[int, str] = {}
        self._lines = ["lines"]

    @property
    def message_count(self) -> int:
        return self.counts.total()

    def write_schema(self, number: int, name: str, definition: str) -> None:
        self._names[number] = name

    def write_channel(self, number: int, schema: int, topic: TopicMetadata, extra: Mapping[str, str]) -> None:
        self._lines.append(json.dumps([number, "topic", topic.name, self._names[schema]]))

    def write_chunk(self, chunk: Lines) -> None:
        for channel, *times, data in chunk:
            self._lines.append(json.dumps([channel, "message", *times, data.hex()]))
            self.counts[channel] += 1
        self.size += chunk.size

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        pass

    def close(self) -> None:
        self.is_open = False
        self.path.write_text("\n".join(self._lines))


class ReadLines:
    """A Storage."""

    identifier = "lines"
    suffix = ".lines"
    magic = b"lines"

    def open(self, path: Path, content: Path | None = None) -> LinesFile:
        return LinesFile(path, content or path)

    def repair(self, file: Any, metadata: BagMetadata) -> list[str] | None:
        return ["the weather"] if file.path.stem.endswith("1") else None


class LinesStorage(ReadLines):
    """A WritableStorage."""

    presets = ("none", "short")

    def check(self) -> None:
        pass

    def chunk_bytes(self, preset: str) -> int:
        return 10 if preset == "short" else 1000

    def gather(self) -> Lines:
        return Lines()

    def create(self, path: Path, preset: str) -> LinesWriter:
        return LinesWriter(path)


@pytest.fixture(autouse=True)
def _registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the end of each test, the registry forgets the test's storages."""
    monkeypatch.setattr(registry, "_storages", dict(registry._storages))


def test_a_bag_is_written_and_read(tmp_path: Path) -> None:
    register(LinesStorage())
    messages = said(30)
    folder = write_bag(
        tmp_path / "walk", messages[:20], messages[20:], storage=writable_storage("lines"), preset="short"
    )
    assert sorted(path.name for path in folder.iterdir()) == ["metadata.yaml", "walk_0.lines", "walk_1.lines"]
    with open_bag(folder) as reader:
        assert read(reader) == messages
        assert reader.metadata.storage_identifier == "lines"
    (folder / "walk_0.lines").rename(folder / "walk_0.other")
    with open_bag(folder / "walk_0.other") as reader:
        assert read(reader) == messages[:20]


def test_a_bag_is_converted_to_it_and_back(tmp_path: Path) -> None:
    register(LinesStorage())
    write_bag(tmp_path / "one", said(30))
    for before, after, storage in (("one", "two", "lines"), ("two", "three", "mcap")):
        options = f"output_bags: [{{uri: {tmp_path / after}, storage_id: {storage}}}]"
        convert([tmp_path / before], read_outputs(options), lambda done, total: None)
        with open_bag(tmp_path / after) as reader:
            assert read(reader) == said(30)
            assert reader.metadata.storage_identifier == storage


def test_a_bag_is_repaired(tmp_path: Path) -> None:
    register(LinesStorage())
    folder = write_bag(tmp_path / "walk", said(3), said(6, first=3), storage=writable_storage("lines"))
    (folder / "metadata.yaml").unlink()
    heard: list[str] = []
    problems = reindex(folder, heard.append)
    assert [one.text for one in problems] == ["the weather"]
    assert heard == [
        "walk_1.lines: rewritten with an index, 6 messages",
        "metadata.yaml: 9 messages in 2 files",
    ]


def test_a_storage_that_is_only_read(tmp_path: Path) -> None:
    register(ReadLines())
    storage = find_storage(".lines")
    assert storage is not None and storage in storages() and storage not in writable_storages()
    with pytest.raises(BagError, match="storage_id 'lines' can't be written; bags are written as 'mcap'"):
        writable_storage("lines")
    with pytest.raises(BagError, match="storage_id 'lines' can't be written"):
        read_outputs("output_bags: [{uri: a, storage_id: lines}]")
    assert suffix_list() == ".mcap or .db3 or .lines"


def test_the_command_line_knows_it() -> None:
    register(LinesStorage())
    recorder, player = ArgumentParser(), ArgumentParser()
    record.add_arguments(recorder)
    playargs.add_reader_arguments(player)
    assert recorder.parse_args(["-a", "-s", "lines", "--storage-preset-profile", "short"]).storage == "lines"
    assert player.parse_args(["walk", "-s", "lines"]).storage == "lines"
    assert "a file .mcap or .db3 or .lines" in " ".join(player.format_help().split())


def test_an_unknown_preset(tmp_path: Path) -> None:
    register(LinesStorage())
    with pytest.raises(BagError, match=r"unknown LINES .* \(valid options are 'none', 'short'\): zstd_fast"):
        BagWriter(tmp_path / "walk", storage=writable_storage("lines"), preset="zstd_fast")


def test_what_no_storage_begins_like_is_taken_for_mcap(tmp_path: Path) -> None:
    (tmp_path / "walk").write_bytes(b"SQLit")
    assert storage_of(tmp_path / "walk") is registry.DEFAULT


def test_a_storage_may_take_messages_in_buffers(tmp_path: Path) -> None:
    register(LinesStorage())
    writer = BagWriter(tmp_path / "one", storage=writable_storage("lines"))
    assert not writer.takes_packs
    assert writer.write_packed(0, 0, b"", lambda *_: (b"record", b"")) == 0
    writer.close()
    other = BagWriter(tmp_path / "other")
    assert other.takes_packs
    other.close()

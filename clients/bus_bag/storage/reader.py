"""Reads a bag: a folder, or a single file."""

import re
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

import msgspec

from bus_bag.errors import BagError
from bus_bag.metadata import (
    NAME,
    BagMetadata,
    FileInformation,
    TopicInformation,
    TopicMetadata,
    from_yaml,
    time_span,
)
from bus_bag.storage.bag_file import BagFile, BagMessage, Order, Problem
from bus_bag.storage.compressed import SUFFIX as COMPRESSED
from bus_bag.storage.compressed import decompress_messages, open_compressed
from bus_bag.storage.merge import Place, merge, timed
from bus_bag.storage.registry import find_storage, storage_of, suffix_list
from bus_bag.storage.stretches import Stretch

__all__ = ["BagReader", "open_bag"]

_MAX_METADATA = 64 << 20


def open_bag(path: Path) -> "BagReader":
    """Open the bag in a folder, or a single file, complete or cut off.

    Opens its files and reads their descriptions, but no messages. Raises BagError with one sentence if there
    is no bag, or if no part of it is readable; OSError if it can't be opened.
    """
    if not path.exists():
        raise BagError(f"Bag path '{path}' does not exist!")
    return BagReader(path)


class BagReader:
    """An open bag, made by `open_bag`.

    Unreadable parts are skipped, and are in `problems`. With `all_files`, it reads all files of the folder,
    without regard to metadata.yaml.
    """

    def __init__(self, path: Path, *, all_files: bool = False) -> None:
        self.path = path
        self._takes_all = all_files
        self.files: list[BagFile] = []
        self.topics: dict[str, TopicMetadata] = {}
        """Topics by name, in the order of their names."""
        self.extra: dict[str, dict[str, str]] = {}
        """Topic -> further metadata in the files: `busd.type_hash`, `busd.schema`."""
        self.definitions: dict[str, str] = {}
        """Type -> its definition in the language of .msg files, including definitions of all types that it
        needs."""
        self._problems: list[Problem] = []
        self._said: BagMetadata | None = None
        try:
            self._open_files(self._find_files() if path.is_dir() else [path])
        except BaseException:
            self.close()
            raise
        self.metadata = self._metadata()
        """The metadata of the present files, with further values such as custom data from metadata.yaml or
        the files."""

    @property
    def is_cut(self) -> bool:
        """Whether a file was not closed properly: its recorder was killed, or its end is missing."""
        return any(file.is_cut for file in self.files)

    @property
    def is_being_written(self) -> bool:
        """Whether a recorder still writes it, if the files show that."""
        return any(file.is_being_written for file in self.files)

    @property
    def problems(self) -> list[Problem]:
        """All unreadable parts so far."""
        return [*self._problems, *(problem for file in self.files for problem in file.problems)]

    def messages(
        self, start: int | None = None, topics: Collection[str] | None = None, by: Order = "log_time"
    ) -> Iterator[BagMessage]:
        """Messages of all files in the order of the time `by`; `start`: from that time on; `topics`: only of
        these."""
        wanted = None if topics is None else frozenset(topics)

        def place(file: BagFile) -> Place[BagMessage]:
            # Publish times are only known after reading the messages.
            begin = file.summary.starting_time if by == "log_time" else 0
            return Place(begin, lambda: timed(file.messages(start, wanted, by), by))

        files = [
            file for file in self.files if start is None or by != "log_time" or file.summary.end_time >= start
        ]
        if len(files) == 1:
            messages = files[0].messages(start, wanted, by)
        else:
            messages = merge([place(file) for file in files])
        if self.metadata.compression_mode.upper() == "MESSAGE":
            return decompress_messages(messages, self.path, self._problems)
        return messages

    def stretches(self, least: int, topics: Collection[str], by: Order = "log_time") -> Iterator[Stretch]:
        """Times with messages of `topics`; see `BagFile`.

        Reads the index; for publish times, and without an index, all messages.
        """
        wanted = frozenset(topics)
        return (one for file in self.files for one in file.stretches(least, wanted, by))

    def close(self) -> None:
        """Close its files."""
        for file in self.files:
            file.close()

    def __enter__(self) -> "BagReader":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def _find_files(self) -> list[Path]:
        """The files of a folder that metadata.yaml names; without it, all files that may be of a bag."""
        self._said = self._read_metadata(self.path / NAME)
        if self._said is not None and self._said.relative_file_paths and not self._takes_all:
            return [self._inside(name) for name in self._said.relative_file_paths]
        found = [path for path in self.path.iterdir() if _is_bag_file(path) and path.is_file()]
        if not found:
            raise BagError(
                f"'{self.path}' is not a bag: there is neither a {NAME} nor a file {suffix_list()} in it"
            )
        return sorted(found, key=_number_first)

    def _inside(self, name: str) -> Path:
        """The path of a file. Versions below 4 had the folder in the name."""
        path = self.path / name
        beside = self.path / Path(name).name
        return beside if beside.exists() or not path.exists() else path

    def _read_metadata(self, path: Path) -> BagMetadata | None:
        try:
            if path.exists() and not path.is_file():
                raise ValueError("it is not a file")
            if path.stat().st_size > _MAX_METADATA:
                raise ValueError(f"it is larger than {_MAX_METADATA:,} bytes")
            return from_yaml(path.read_text(errors="replace"))
        except FileNotFoundError:
            self._problems.append(Problem(str(path), None, "it is missing; the bag's files are read instead"))
        except ValueError as error:
            self._problems.append(Problem(str(path), None, f"it can't be used: {error}"))
        return None

    def _open_files(self, paths: list[Path]) -> None:
        reasons: list[Exception] = []
        for path in paths:
            try:
                file = _open_file(path)
            except (BagError, OSError) as error:
                reasons.append(error)
                self._problems.append(Problem(str(path), None, str(error)))
                continue
            self.files.append(file)
            for name, topic in file.topics.items():
                known = self.topics.setdefault(name, topic)
                if known.type != topic.type:
                    text = f"topic '{name}' is {topic.type} here and {known.type} before"
                    self._problems.append(Problem(str(path), None, text))
                self.extra.setdefault(name, dict(file.extra.get(name, {})))
            for name, definition in file.definitions.items():
                self.definitions.setdefault(name, definition)
        if not self.files and reasons:
            raise reasons[0]
        said = (
            {one.topic_metadata.name: one.topic_metadata for one in self._said.topics} if self._said else {}
        )
        self.topics = {name: _filled(self.topics[name], said.get(name)) for name in sorted(self.topics)}

    def _metadata(self) -> BagMetadata:
        said = self._said
        for file in self.files:
            if said is None:
                said = file.metadata()
        said = said or BagMetadata()
        counts: Counter[str] = Counter()
        files = []
        for file in self.files:
            summary = file.summary
            counts.update(summary.counts)
            length = max(summary.end_time - summary.starting_time, 0)
            files.append(
                FileInformation(file.path.name, summary.starting_time, length, summary.message_count)
            )
        start, duration = time_span(files)
        return BagMetadata(
            storage_identifier=self.files[0].storage,
            starting_time=start,
            duration=duration,
            message_count=counts.total(),
            topics=tuple(TopicInformation(topic, counts[name]) for name, topic in self.topics.items()),
            files=tuple(files),
            relative_file_paths=tuple(file.path for file in files),
            compression_format=said.compression_format,
            compression_mode=said.compression_mode,
            custom_data=said.custom_data,
            ros_distro=said.ros_distro,
            version=said.version,
        )


def _filled(topic: TopicMetadata, said: TopicMetadata | None) -> TopicMetadata:
    """A topic completed by metadata.yaml: files of older versions and of other tools lack some values."""
    if said is None or said.type != topic.type:
        return topic
    return msgspec.structs.replace(
        topic,
        offered_qos_profiles=topic.offered_qos_profiles or said.offered_qos_profiles,
        type_description_hash=topic.type_description_hash or said.type_description_hash,
    )


def _open_file(path: Path) -> BagFile:
    if "\0" in str(path):
        raise BagError(f"no file can have the path {str(path)!r}")
    if path.exists() and not path.is_file():
        raise BagError(f"'{path}' is not a file")
    if path.suffix == COMPRESSED:
        return open_compressed(path)
    return storage_of(path).open(path)


def _is_bag_file(path: Path) -> bool:
    """Whether its name is a name of a bag's file."""
    inner = path.with_suffix("") if path.suffix == COMPRESSED else path
    return find_storage(inner.suffix) is not None


def _number_first(path: Path) -> tuple[int, str]:
    number = re.search(r"_(\d{1,18})$", path.name.partition(".")[0])
    return (int(number[1]) if number else -1, path.name)

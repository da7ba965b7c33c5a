"""Writes a bag: a folder of files, and metadata.yaml at the end."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from bus_bag.errors import BagError
from bus_bag.metadata import (
    NAME,
    BagMetadata,
    TopicInformation,
    TopicMetadata,
    time_span,
    to_record,
    to_yaml,
)
from bus_bag.storage.bag_file import Buffer, PackGatherer, Records, Stamp
from bus_bag.storage.bag_files import BagFiles
from bus_bag.storage.registry import DEFAULT, WritableStorage

__all__ = ["BagWriter", "write_metadata_file"]

Job: TypeAlias = Callable[[], None]
_MAX_CHANNELS = 1 << 16


_Topic = tuple[int, TopicMetadata, Mapping[str, str]]
"""The number of its schema, the topic, and what is stored with it."""
_Topics = Sequence[_Topic]


class BagWriter:
    """Writes a bag: `<folder>/<folder>_0.mcap` and so on, as files of `storage`, then metadata.yaml.

    Messages are gathered in the caller's thread. Everything that touches files is a job. `run` gets each job,
    and the size of the messages that it writes. By default a job runs at once. A recorder passes jobs to a
    thread, which must run them one at a time, in order. A job raises BagFull if nothing more fits, and
    OSError for other faults. After both, the caller must still call `write_metadata` and `close`. They make a
    readable bag of the written part. If a further file could not be made, later messages are not written.
    Jobs call `on_split(closed, opened)` after the start of a further file.

    `preset` is a preset of the storage. With more than `most_files` files, the oldest is deleted; 0: no
    limit. Raises BagError if the folder exists, for an unknown preset, and if a package of the storage is
    missing; OSError if the folder can't be made.
    """

    def __init__(
        self,
        folder: Path,
        *,
        storage: WritableStorage = DEFAULT,
        preset: str = "none",
        custom_data: Mapping[str, str] | None = None,
        ros_distro: str = "jazzy",
        most_files: int = 0,
        run: Callable[[Job, int], None] | None = None,
        on_split: Callable[[Path, Path], object] | None = None,
    ) -> None:
        if preset not in storage.presets:
            valid = ", ".join(f"'{name}'" for name in storage.presets)
            kind = storage.identifier.upper()
            raise BagError(f"unknown {kind} storage preset profile (valid options are {valid}): {preset}")
        storage.check()  # before the folder is made: an error leaves nothing behind
        self.folder = folder
        self._storage = storage
        self._custom_data = dict(custom_data or {})
        self._ros_distro = ros_distro
        self._run = run or _run_at_once
        self._on_split = on_split
        self._builder = storage.gather()
        self._packs = self._builder if isinstance(self._builder, PackGatherer) else None
        self._limit = storage.chunk_bytes(preset)
        self._topics: list[_Topic] = []
        self._schemas: dict[tuple[str, str], int] = {}
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise BagError(f"Output folder '{folder}' already exists.") from None
        self.data_size = 0
        """Bytes of messages in all files: without gathered messages and waiting jobs, and without other parts
        of a file."""
        self._files = BagFiles(folder, storage, preset, most_files)
        """Only jobs change it."""
        self._write_own_metadata(())

    def add_topic(self, topic: TopicMetadata, definition: str, extra: Mapping[str, str] | None = None) -> int:
        """Add a topic to record; returns its channel, for `write`.

        `definition` describes its type in the language of .msg files, with the definitions of all types that
        it needs. `extra` is stored with the topic.
        """
        if len(self._topics) == _MAX_CHANNELS:
            raise BagError(f"a bag can have at most {_MAX_CHANNELS} topics")
        schema = self._schemas.setdefault((topic.type, definition), len(self._schemas) + 1)
        entry = (schema, topic, dict(extra or {}))
        self._topics.append(entry)
        channel = len(self._topics) - 1
        is_new = schema == len(self._schemas) and not any(one[0] == schema for one in self._topics[:-1])

        def add() -> None:
            if is_new:
                self._files.present.write_schema(schema, topic.type, definition)
            self._files.present.write_channel(channel, *entry)

        self._run(add, 0)
        return channel

    def write(
        self, channel: int, log_time: int, publish_time: int, sequence: int, parts: Sequence[Buffer]
    ) -> int:
        """Add a message in parts; the `len` of each part is its number of bytes. Returns the bytes that it
        uses.

        The parts must not change until the job that writes them has run. Times are nanoseconds since 1970.
        """
        taken = self._builder.add(channel, log_time, publish_time, sequence, parts)
        if self._builder.size >= self._limit:
            self.flush()
        return taken

    def write_many(self, channel: int, stamps: Sequence[Stamp], messages: Sequence[Buffer]) -> int:
        """Add short messages of one topic, with one part each; returns the bytes that they use.

        This is faster than one by one. They go into one chunk, whatever their number.
        """
        taken = self._builder.add_many(channel, stamps, messages)
        if self._builder.size >= self._limit:
            self.flush()
        return taken

    @property
    def takes_packs(self) -> bool:
        """Whether the storage has `write_packed`."""
        return self._packs is not None

    def write_packed(self, channel: int, log_time: int, data: bytes, records: Records) -> int:
        """Add messages in one buffer; returns the bytes that they use. Returns 0 and adds nothing if
        `records` refuses them. See `PackGatherer`."""
        taken = 0 if self._packs is None else self._packs.add_packed(channel, log_time, data, records)
        if self._builder.size >= self._limit:
            self.flush()
        return taken

    def flush(self) -> None:
        """Write the gathered messages."""
        chunk = self._builder.close()
        if chunk is None:
            return

        def write() -> None:
            file = self._files.present
            if file.is_open:  # see `_close_file`
                before = file.size
                file.write_chunk(chunk)
                self.data_size += file.size - before

        self._run(write, chunk.size)

    def split(self) -> None:
        """Continue in the next file."""
        self.flush()
        topics, schemas = list(self._topics), dict(self._schemas)

        def split() -> None:
            closed = self._files.present.path
            self._close_file(topics)
            self._files.open_next()
            self._write_own_metadata(topics)
            file = self._files.present
            for (name, definition), number in schemas.items():
                file.write_schema(number, name, definition)
            for channel, entry in enumerate(topics):
                file.write_channel(channel, *entry)
            if self._on_split is not None:
                self._on_split(closed, file.path)

        self._run(split, 0)

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record to the current file, after everything written."""
        self.flush()
        kept = dict(values)

        def write() -> None:
            if self._files.present.is_open:  # see `_close_file`
                self._files.present.write_metadata(name, kept)

        self._run(write, 0)

    def close(self) -> None:
        """Close the last file and write metadata.yaml."""
        self.flush()
        topics = list(self._topics)

        def close() -> None:
            self._close_file(topics)
            write_metadata_file(self.folder, self.metadata())

        self._run(close, 0)

    @property
    def gathered(self) -> int:
        """Bytes of messages that wait for `flush`."""
        return self._builder.size

    @property
    def size(self) -> int:
        """Bytes in all files, without gathered messages and waiting jobs."""
        return self._files.size

    def counts(self) -> dict[str, int]:
        """Topic -> number of messages in the files, including deleted files, without waiting and lost
        messages."""
        return dict(self._by_topic(self._files.counts(), list(self._topics)))

    def _by_topic(self, counts: Mapping[int, int], topics: _Topics) -> Counter[str]:
        """Sum up channels by topic. A topic may have several channels."""
        found: Counter[str] = Counter()
        for channel, (_, topic, _) in enumerate(topics):
            found[topic.name] += counts.get(channel, 0)
        return found

    def metadata(self) -> BagMetadata:
        """The metadata of all files. For jobs, or after all jobs have run."""
        return self._metadata(list(self._topics))

    def _metadata(self, known: _Topics) -> BagMetadata:
        """The same with the topics that were known when the job was made."""
        files = self._files.information()
        start, duration = time_span(files)
        counts = self._by_topic(self._files.counts_there(), known)
        topics: dict[str, TopicInformation] = {}
        for _, topic, _ in known:
            topics.setdefault(topic.name, TopicInformation(topic, counts[topic.name]))
        return BagMetadata(
            storage_identifier=self._storage.identifier,
            starting_time=start,
            duration=duration,
            message_count=sum(file.message_count for file in files),
            topics=tuple(topics.values()),
            files=tuple(files),
            relative_file_paths=tuple(file.path for file in files),
            custom_data=self._custom_data,
            ros_distro=self._ros_distro,
        )

    def _write_own_metadata(self, topics: _Topics) -> None:
        """Write the known metadata of the whole bag into the current file."""
        record = to_record(self._metadata(topics))
        self._files.present.write_metadata("rosbag2", {"serialized_metadata": record})

    def _close_file(self, topics: _Topics) -> None:
        if self._files.present.is_open:  # otherwise a further file could not be made
            self._write_own_metadata(topics)
            self._files.close()


def write_metadata_file(folder: Path, metadata: BagMetadata) -> None:
    """Write metadata.yaml in one step. Raises OSError; then an existing file is unchanged."""
    beside = folder / f"{NAME}.tmp"
    try:
        beside.write_text(to_yaml(metadata))
        beside.replace(folder / NAME)
    finally:
        beside.unlink(missing_ok=True)


def _run_at_once(job: Job, size: int) -> None:
    job()

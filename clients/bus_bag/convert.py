"""`bus bag convert`: writes bags again by a file of options: chosen topics, other files, compression.

`Output` has the options that are used. Other options of rosbag2 are accepted without effect.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from bus.base.suggest import did_you_mean
from bus.errors import BusError
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag import losses
from bus_bag.errors import BagError
from bus_bag.info import find_losses
from bus_bag.metadata import TopicMetadata
from bus_bag.record.choice import Choice, Wanted
from bus_bag.record.splitting import Splitting
from bus_bag.storage import BagMessage, BagReader, BagWriter, JoinedBags, open_bags
from bus_bag.storage.registry import DEFAULT, writable_storage
from bus_bag.topic_names import absolute_names
from bus_bag.yaml_text import load
from bus_ros.cdr import codec_of

__all__ = ["Output", "convert", "read_outputs"]

_NS_PER_S = 1_000_000_000
_LOOK = 1000
"""Number of messages between two calls of `progress`."""
_CHOICES = ("topics", "topic_types", "services", "exclude_topics", "exclude_topic_types", "exclude_services")
"""Options with lists of names."""
_WITHOUT_EFFECT = {
    "max_cache_size",
    "storage_config_uri",
    "snapshot_mode",
    "is_discovery_disabled",
    "topic_polling_interval",
    "node_prefix",
    "compression_queue_size",
    "compression_threads",
    "compression_threads_priority",
    "topic_qos_profile_overrides",
    "include_unpublished_topics",
    "ignore_leaf_topics",
    "start_paused",
    "use_sim_time",
    "disable_keyboard_controls",
    "rmw_serialization_format",
    "input_serialization_format",
    "output_serialization_format",
}


class Output(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a bag to write."""

    uri: Path
    storage: str = DEFAULT.identifier
    preset: str = "none"
    wanted: Wanted | None = None
    """None: all topics, also hidden ones."""
    most_bytes: int = 0
    most_s: float = 0.0
    start: int | None = None
    """Nanoseconds since 1970, like `end`. A message at `end` is included."""
    end: int | None = None
    custom_data: Mapping[str, str] | None = None
    """None: the same as in the input bags."""


def read_outputs(text: str) -> list[Output]:
    """Read a file of options. Raises BagError for unusable ones."""
    try:
        document = load(text)
    except ValueError as error:
        raise BagError(str(error)) from None
    entries = document.get("output_bags") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries:
        raise BagError("it has no list 'output_bags'")
    return [_Options(entry).output() for entry in entries]


class _Topic(NamedTuple):
    metadata: TopicMetadata
    definition: str
    extra: dict[str, str]


class _Options:
    """The options of one bag. Reading an option removes it, so the remaining ones are unknown."""

    def __init__(self, entry: object) -> None:
        if not isinstance(entry, dict):
            raise BagError("an entry of 'output_bags' is not a map")
        self._left: dict[str, Any] = {str(key): value for key, value in entry.items()}

    def output(self) -> Output:
        uri = self._take("uri", str, "")
        if not uri:
            raise BagError("an entry of 'output_bags' has no 'uri'")
        storage = self._take("storage_id", str, "") or DEFAULT.identifier
        writable_storage(storage)
        output = Output(
            uri=Path(uri),
            storage=storage,
            preset=self._preset(),
            wanted=self._wanted(),
            most_bytes=self._take("max_bagfile_size", int, 0),
            most_s=float(self._take("max_bagfile_duration", (int, float), 0)),
            start=self._moment("start_time_ns"),
            end=self._moment("end_time_ns"),
            custom_data=self._custom_data(),
        )
        for key in self._left.keys() - _WITHOUT_EFFECT:
            known = [*_CHOICES, "uri", "storage_id", "all_topics", "all_services", "regex", "exclude_regex"]
            raise BagError(f"Unknown output option '{key}'{did_you_mean(key, known)}")
        return output

    def _take(self, key: str, kind: type | tuple[type, ...], default: Any) -> Any:
        value = self._left.pop(key, None)
        if value is None:
            return default
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise BagError(f"output option '{key}' can't be {value!r}")
        if isinstance(value, int | float) and value < 0:
            raise BagError(f"output option '{key}' may not be negative, but is {value}")
        return value

    def _moment(self, key: str) -> int | None:
        time = self._left.pop(key, None)
        if time is None or time == -1:  # rosbag2's value for "not set"
            return None
        self._left[key] = time
        return int(self._take(key, int, 0))

    def _custom_data(self) -> Mapping[str, str] | None:
        values = self._take("custom_data", dict, None)
        return None if values is None else {str(key): str(value) for key, value in values.items()}

    def _preset(self) -> str:
        """The preset. Compression applies to chunks, whatever the mode, because every reader of MCAP unpacks
        chunks."""
        mode = self._take("compression_mode", str, "").lower()
        kind = self._take("compression_format", str, "").lower()
        preset = self._take("storage_preset_profile", str, "")
        if mode not in ("", "none", "file", "message"):
            raise BagError(f"compression_mode '{mode}' is none of 'none', 'file', 'message'")
        if kind not in ("", "zstd"):
            raise BagError(f"compression_format '{kind}' can't be written; use 'zstd'")
        if mode not in ("file", "message"):
            return preset or "none"
        if preset == "fastwrite":
            raise BagError("compression_mode compresses chunks, and a file of 'fastwrite' has none")
        return "zstd_fast" if preset in ("", "none") else preset

    def _wanted(self) -> Wanted | None:
        names: dict[str, Any] = {}
        for key in _CHOICES:
            values = self._take(key, list, None)
            if values:
                texts = map(str, values)
                names[key] = frozenset(texts) if "types" in key else absolute_names(texts)
        takes_all = self._take("all", bool, False)
        for key in ("all_topics", "all_services"):
            if self._take(key, bool, False) or takes_all:
                names[key] = True
        for key, field in (
            ("regex", "regex"),
            ("exclude", "exclude_regex"),
            ("exclude_regex", "exclude_regex"),
        ):
            if pattern := self._take(key, str, ""):
                names[field] = pattern
        hidden = self._take("include_hidden_topics", bool, False)
        if not names:
            return None
        if all(name.startswith("exclude") for name in names):
            names |= {"all_topics": True, "all_services": True}
        return Wanted(include_hidden_topics=hidden, **names)


def convert(
    inputs: Sequence[Path], outputs: Sequence[Output], progress: Callable[[int, int], object]
) -> list[str]:
    """Write the messages of all `inputs` into each of the `outputs` that wants them, by log time.

    `progress` is called from time to time with the number of messages read so far, and of all messages.
    Returns descriptions of everything that could not be read, or not written unchanged. If it is interrupted,
    or if the disk is full, the part written so far is a complete bag.

    Raises BagError for bags that can't be read or written, ConfigurationError for an invalid regular
    expression, OSError for faults of the disk.
    """
    if not inputs or not outputs:
        raise BagError("Must provide at least one input and one output bag to rewrite.")
    warnings: list[str] = []
    with open_bags(inputs) as bags:
        topics = {name: _described(bags, name, warnings) for name in bags.topics}
        for output in outputs:
            if output.uri.exists():
                raise BagError(f"Output folder '{output.uri}' already exists.")
        with ExitStack() as closing:
            writers = []
            for output in outputs:
                writers.append(_Writer(output, bags.readers, topics))
                closing.callback(writers[-1].close)
            _copy(bags, writers, progress)
        warnings += map(str, bags.problems)
    return warnings


def _copy(bags: JoinedBags, writers: Sequence["_Writer"], progress: Callable[[int, int], object]) -> None:
    done = 0
    for message in bags.messages():
        for writer in writers:
            writer.write(message)
        done += 1
        if not done % _LOOK:
            progress(done, bags.message_count)
    progress(done, bags.message_count)


def _described(bags: JoinedBags, name: str, warnings: list[str]) -> _Topic:
    """A topic with the description of its type. Old bags lack it: then this uses the local type of that
    name."""
    topic = _Topic(bags.topics[name], bags.definition_of(name), bags.extra_of(name))
    metadata, definition, extra = topic
    if definition or metadata.serialization_format != "cdr":
        return topic
    try:
        codec = codec_of(MessageSchema.of(message_class(metadata.type)))
    except (BusError, LookupError, ValueError):
        warnings.append(
            f"topic '{metadata.name}': no definition of {metadata.type} found; it is copied without one"
        )
        return topic
    known = metadata.type_description_hash or codec.type_hash
    return _Topic(msgspec.structs.replace(metadata, type_description_hash=known), codec.definition, extra)


class _Writer:
    """Writes one of the output bags."""

    def __init__(self, output: Output, readers: Sequence[BagReader], topics: Mapping[str, _Topic]) -> None:
        self._output = output
        self._splitting = Splitting(output.most_bytes, output.most_s)
        choice = Choice(output.wanted, "") if output.wanted is not None else None
        chosen = {
            name: known
            for name, known in topics.items()
            if choice is None or choice.takes(name, {known.metadata.type})
        }
        said = readers[0].metadata
        custom = output.custom_data if output.custom_data is not None else said.custom_data
        self._writer = BagWriter(
            output.uri,
            storage=writable_storage(output.storage),
            preset=output.preset,
            custom_data=custom,
            ros_distro=said.ros_distro,
        )
        self._channels: dict[str, int] = {}
        for name, (topic, definition, extra) in chosen.items():
            self._channels[name] = self._writer.add_topic(topic, definition, extra)
        is_whole = len(readers) == 1 and output.start is None and output.end is None
        found = find_losses(readers[0]) if is_whole else {}
        self._losses = {topic: one for topic, one in found.items() if topic in chosen}
        """The recorder's counters; empty for several bags, or for a part of a bag."""

    def write(self, message: BagMessage) -> None:
        channel = self._channels.get(message.topic)
        time, output = message.log_time, self._output
        if (
            channel is None
            or (output.start is not None and time < output.start)
            or (output.end is not None and time > output.end)
        ):
            return
        writer = self._writer
        while self._splitting and self._splitting.is_due(writer.size + writer.gathered, time):
            writer.split()
            self._splitting.split(writer.size)
        writer.write(channel, time, message.publish_time, message.sequence, [message.data])

    def close(self) -> None:
        if self._losses:
            self._writer.write_metadata(losses.RECORD, losses.to_record(self._losses))
        self._writer.close()

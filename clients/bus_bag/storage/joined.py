"""Several bags that are read as one, in the order of time."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path

import msgspec

from bus.qos import QoSProfile
from bus_bag.metadata import TopicMetadata, time_span
from bus_bag.storage.bag_file import BagMessage, Order, Problem
from bus_bag.storage.merge import Place, merge, timed
from bus_bag.storage.reader import BagReader, open_bag
from bus_bag.storage.stretches import Stretch, gaps_between

__all__ = ["JoinedBags", "open_bags"]


def open_bags(paths: Sequence[Path]) -> "JoinedBags":
    """Open bags to read them as one. Raises the errors of `open_bag` for the first bag that can't be opened.

    A single path makes the same as the bag alone.
    """
    with ExitStack() as stack:
        readers = [stack.enter_context(open_bag(path)) for path in paths]
        stack.pop_all()
    return JoinedBags(readers)


class JoinedBags:
    """The topics and messages of all `readers`, of at least one bag.

    A topic has the type that it has in the first bag with it. Its messages in a bag with another type, or
    with another definition of the type, are left out, and `problems` says so. It has the QoS profiles of all
    bags. If several bags have a profile, it counts as often as in the bag with most of it: parts of one
    recording repeat the profiles of the same publishers. `close` also closes the readers.
    """

    def __init__(self, readers: Sequence[BagReader]) -> None:
        self.readers = readers
        self.topics: dict[str, TopicMetadata] = {}
        """Topics by name, in the order of their names."""
        self._definitions: dict[str, str] = {}
        self._extra: dict[str, dict[str, str]] = {}
        self._chosen: list[frozenset[str]] = []
        """The topics to read from each bag."""
        self._problems: list[Problem] = []
        for reader in readers:
            self._chosen.append(frozenset(name for name in reader.topics if self._join(reader, name)))
        self.topics = dict(sorted(self.topics.items()))
        files = [file for reader in readers for file in reader.metadata.files]
        self.starting_time, self.duration = time_span(files)
        """The first reception of a message, and the time from it to the last one, in ns."""
        self.message_count = sum(file.message_count for file in files)

    @property
    def problems(self) -> list[Problem]:
        """All unreadable parts so far, and topics that were left out."""
        return [*self._problems, *(problem for reader in self.readers for problem in reader.problems)]

    def definition_of(self, topic: str) -> str:
        """The definition of a topic's type, as in `BagReader.definitions`; empty if no bag has it."""
        return self._definitions[topic]

    def extra_of(self, topic: str) -> dict[str, str]:
        """A topic's further metadata, as in `BagReader.extra`."""
        return self._extra[topic]

    def messages(
        self, start: int | None = None, topics: Collection[str] | None = None, by: Order = "log_time"
    ) -> Iterator[BagMessage]:
        """Messages of all bags, as `BagReader.messages`. At the same time, the earlier bag comes first."""
        wanted = [chosen if topics is None else chosen.intersection(topics) for chosen in self._chosen]
        if len(self.readers) == 1:
            return self.readers[0].messages(start, wanted[0], by)

        def place(reader: BagReader, names: frozenset[str]) -> Place[BagMessage]:
            # Publish times are only known after reading the messages.
            begin = reader.metadata.starting_time if by == "log_time" else 0
            return Place(begin, lambda: timed(reader.messages(start, names, by), by))

        return merge([place(reader, names) for reader, names in zip(self.readers, wanted, strict=True)])

    def gaps(self, least: int, topics: Collection[str], by: Order = "log_time") -> list[Stretch]:
        """Times of more than `least` without a message of `topics`, in order; see `BagReader.stretches`."""
        pairs = zip(self.readers, self._chosen, strict=True)
        found = (reader.stretches(least, chosen.intersection(topics), by) for reader, chosen in pairs)
        return gaps_between(chain.from_iterable(found), least)

    def close(self) -> None:
        """Close the bags."""
        for reader in self.readers:
            reader.close()

    def __enter__(self) -> "JoinedBags":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def _join(self, reader: BagReader, name: str) -> bool:
        """Take a topic of a bag; returns whether it fits the topic of the earlier bags."""
        topic = reader.topics[name]
        definition, extra = reader.definitions.get(topic.type, ""), reader.extra.get(name, {})
        known = self.topics.get(name)
        if known is None:
            self.topics[name] = topic
            self._definitions[name] = definition
            self._extra[name] = dict(extra)
            return True
        hashes = {known.type_description_hash, topic.type_description_hash} - {""}
        if known.type != topic.type or len(hashes) > 1:
            kind = topic.type if known.type != topic.type else f"another {topic.type}"
            text = f"topic '{name}' is {kind} here and {known.type} before; left out"
            self._problems.append(Problem(str(reader.path), None, text))
            return False
        self.topics[name] = msgspec.structs.replace(
            known,
            offered_qos_profiles=_united(known.offered_qos_profiles, topic.offered_qos_profiles),
            type_description_hash=known.type_description_hash or topic.type_description_hash,
        )
        self._definitions[name] = self._definitions[name] or definition
        return True


def _united(known: tuple[QoSProfile, ...], others: tuple[QoSProfile, ...]) -> tuple[QoSProfile, ...]:
    new = list(others)
    for profile in known:
        if profile in new:
            new.remove(profile)
    return (*known, *new)

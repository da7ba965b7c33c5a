"""Messages that a recording lacks, and why: the account of each topic, and its record in a file. Pure.

They close: messages that publishers sent to the recorder, by their own numbers = messages written + waiting +
lost for each reason.
"""

from collections.abc import Iterable, Mapping

import msgspec

from bus.vocabulary import DropReason

__all__ = ["RECORD", "TopicLosses", "from_record", "lines", "to_record"]

RECORD = "busd.losses"
"""The name of the metadata record; the last one of the last file tells of the whole recording."""


class TopicLosses(msgspec.Struct, frozen=True, omit_defaults=True):
    """Messages of one topic, since its recording began."""

    expected: int
    """Messages by the publishers' numbers, without those that came while the recording was paused."""
    written: int = 0
    """Messages in the files, also in those deleted since, without repetitions in further files."""
    waiting: int = 0
    """On their way into the file when this was counted; 0 at the end."""
    lost: dict[str, int] = {}
    """By reason, as a subscription's statistics have them; `recorder_cache`: there was no room in the
    recorder; `not_written`: the disk was full, or the recording was ended at once."""

    @property
    def is_balanced(self) -> bool:
        return self.expected == self.written + self.waiting + sum(self.lost.values())

    def closed(self) -> "TopicLosses":
        """The account when nothing is on its way any more: messages still missing are lost for an unknown
        reason."""
        if not self.waiting:
            return self
        lost = {**self.lost, DropReason.UNEXPLAINED: self.lost.get(DropReason.UNEXPLAINED, 0) + self.waiting}
        return msgspec.structs.replace(self, waiting=0, lost=lost)


def to_record(topics: Mapping[str, TopicLosses]) -> dict[str, str]:
    """The values of the record: topic -> JSON."""
    return {topic: msgspec.json.encode(losses).decode() for topic, losses in topics.items()}


def from_record(values: Mapping[str, str]) -> dict[str, TopicLosses]:
    """The contents of such a record. Raises ValueError if it is broken."""
    return {topic: msgspec.json.decode(text, type=TopicLosses) for topic, text in values.items()}


def lines(topics: Mapping[str, TopicLosses]) -> Iterable[str]:
    """A line for each topic that lacks messages, with the reasons; nothing if nothing was lost."""
    for topic, losses in sorted(topics.items()):
        if total := sum(losses.lost.values()):
            reasons = ", ".join(
                f"{reason}: {count}" for reason, count in sorted(losses.lost.items()) if count
            )
            yield f"{topic}: {total} of {losses.expected} ({reasons})"

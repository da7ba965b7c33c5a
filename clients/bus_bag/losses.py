"""Messages missing in a recording, with reasons: the counters of each topic, and their record in a file.
Pure.

The counters add up: messages that publishers sent to the recorder, by their own numbers = messages written +
waiting + lost for each reason.
"""

from collections.abc import Iterable, Mapping

import msgspec

from bus.vocabulary import DropReason

__all__ = ["RECORD", "TopicLosses", "from_record", "lines", "to_record"]

RECORD = "busd.losses"
"""The name of the metadata record. The last one in the last file counts for the whole recording."""


class TopicLosses(msgspec.Struct, frozen=True, omit_defaults=True):
    """Counters of one topic since the start of its recording."""

    expected: int
    """Number of messages by the publishers' numbers, without messages that came while the recording was
    paused."""
    written: int = 0
    """Messages in the files, including files deleted since. Repetitions in further files do not count."""
    waiting: int = 0
    """Messages on their way into the file at the time of counting; 0 at the end."""
    lost: dict[str, int] = {}
    """Lost messages by reason.

    The reasons are the ones in a subscription's statistics, and two more. `recorder_cache`: there was no room
    in the recorder. `not_written`: the disk was full, or the recording was ended at once.
    """

    @property
    def is_balanced(self) -> bool:
        return self.expected == self.written + self.waiting + sum(self.lost.values())

    def closed(self) -> "TopicLosses":
        """The counters after everything was written: messages still missing are lost for an unknown
        reason."""
        if not self.waiting:
            return self
        lost = {**self.lost, DropReason.UNEXPLAINED: self.lost.get(DropReason.UNEXPLAINED, 0) + self.waiting}
        return msgspec.structs.replace(self, waiting=0, lost=lost)


def to_record(topics: Mapping[str, TopicLosses]) -> dict[str, str]:
    """Make the values of the record: topic -> JSON."""
    return {topic: msgspec.json.encode(losses).decode() for topic, losses in topics.items()}


def from_record(values: Mapping[str, str]) -> dict[str, TopicLosses]:
    """Read the contents of such a record. Raises ValueError if it is broken."""
    return {topic: msgspec.json.decode(text, type=TopicLosses) for topic, text in values.items()}


def lines(topics: Mapping[str, TopicLosses]) -> Iterable[str]:
    """A line for each topic with missing messages, with the reasons; no lines if nothing was lost."""
    for topic, losses in sorted(topics.items()):
        if total := sum(losses.lost.values()):
            reasons = ", ".join(
                f"{reason}: {count}" for reason, count in sorted(losses.lost.items()) if count
            )
            yield f"{topic}: {total} of {losses.expected} ({reasons})"

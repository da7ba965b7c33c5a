"""Messages missing in a recording, with reasons: the counters of each topic, and their record in a file.
Pure.

The counters add up: messages that publishers sent to the recorder, by their own numbers = messages written +
waiting + lost for each reason.
"""

from collections.abc import Iterable, Mapping

import msgspec

from bus.vocabulary import DropReason
from bus_plot.loss_timeline import LossTimeline, Slot

__all__ = ["RECORD", "LossDates", "TopicLosses", "from_record", "lines", "to_record"]

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

    The reasons are the ones in a subscription's statistics, and three more. `recorder_cache`: there was no
    room in the recorder. `not_written`: the disk was full, or the recording was ended at once.
    `unexplained`: no counter has the reason.
    """

    when: list[Slot] = []
    """When they were lost, in whole seconds of the bag's clock; empty in bags of older recorders."""
    earlier: dict[str, int] = {}
    """Lost messages whose time the recorder no longer knows, by reason."""

    @property
    def timeline(self) -> LossTimeline:
        """Raises ValueError if `when` has no valid slots."""
        return LossTimeline.of(self.when, self.earlier)

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


class _Dated:
    """One topic at the last look at its counters."""

    def __init__(self, at_s: float) -> None:
        self.at_s = at_s
        self.expected = 0
        self.lost: dict[str, int] = {}
        self.absent_s: float | None = None
        """The last look before busd went away; None once the topic was heard again."""
        self.timeline = LossTimeline()


class LossDates:
    """Notes when the counters of topics change: the timelines of a recording."""

    def __init__(self) -> None:
        self._topics: dict[str, _Dated] = {}

    def add(self, name: str, at_s: float, reason: DropReason, count: int) -> None:
        """Note messages lost at a known time. Call it before `note` sees them in the counters."""
        topic = self._topics.setdefault(name, _Dated(at_s))
        topic.timeline.add(at_s, at_s, {reason: count})
        topic.lost = {**topic.lost, reason: topic.lost.get(reason, 0) + count}

    def note(
        self, now_s: float, topics: Mapping[str, TopicLosses], *, is_away: bool = False
    ) -> dict[str, TopicLosses]:
        """The counters at that time of the bag's clock, with the times of all losses so far.

        `is_away`: busd is away. Messages missed meanwhile are counted together after its return. So they are
        spread over its absence.
        """
        return {name: self._note(now_s, name, one, is_away=is_away) for name, one in topics.items()}

    def _note(self, now_s: float, name: str, losses: TopicLosses, *, is_away: bool) -> TopicLosses:
        topic = self._topics.setdefault(name, _Dated(now_s))
        if is_away and topic.absent_s is None:
            topic.absent_s = topic.at_s
        new = {reason: count - topic.lost.get(reason, 0) for reason, count in losses.lost.items()}
        if topic.absent_s is not None:
            missed = new.pop(DropReason.DISCONNECTED, 0)
            topic.timeline.add(topic.absent_s, now_s, {DropReason.DISCONNECTED: missed})
        topic.timeline.add(topic.at_s, now_s, new)
        if not is_away and losses.expected != topic.expected:
            topic.absent_s = None
        topic.at_s, topic.expected, topic.lost = now_s, losses.expected, losses.lost
        if not topic.timeline:
            return losses
        return msgspec.structs.replace(losses, when=topic.timeline.slots(), earlier=topic.timeline.earlier)


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

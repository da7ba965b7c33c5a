"""When messages were lost, and how many by reason: bounded, and the sums stay right. Pure."""

from collections.abc import Iterable, Iterator, Mapping

import msgspec

__all__ = ["MOST_EACH", "WIDEST_S", "Burst", "LossTimeline", "Slot"]

MOST_EACH = 60
"""Most slots of each width. If there is one more, the oldest one joins a slot of twice the width."""
WIDEST_S = 1024
"""Width of the widest slots, in seconds. If there are more of them than `MOST_EACH`, the oldest one counts as
`earlier`: with losses in every second, that is after 34 hours."""
_MOST_REASONS = 16
_OTHER = "other"
"""For reasons above the bound: programs may report any reasons."""


class Slot(msgspec.Struct, frozen=True, array_like=True):
    """Messages lost in `width_s` seconds from `at_s` on."""

    at_s: int
    width_s: int
    lost: dict[str, int]
    """By reason."""

    @property
    def count(self) -> int:
        return sum(self.lost.values())


class Burst(msgspec.Struct, frozen=True, array_like=True):
    """Messages lost one shortly after the other: in `span_s` seconds from `at_s` on."""

    at_s: int
    span_s: int
    lost: dict[str, int]


class LossTimeline:
    """The losses of one topic, or of one subscription.

    Resolution: one second for the newest 60 seconds that have losses, two seconds for the 60 slots before
    them, then four, and so on up to 1,024 s. Seconds without a loss need no slot. So the bound is 660 slots,
    however long it lasts. Older losses stay in `earlier`, without a time.
    """

    __slots__ = ("_tiers", "earlier", "newest_s", "total")

    def __init__(self) -> None:
        self._tiers: list[dict[int, dict[str, int]]] = [{}]
        """For each width (1 s, 2 s, ...): number of the slot -> messages by reason."""
        self.earlier: dict[str, int] = {}
        """Losses, by reason, whose time was never known or is no longer kept."""
        self.total = 0
        """How many messages were lost in all."""
        self.newest_s = -1
        """The end of its newest slot; -1 without one."""

    def add(self, from_s: float, to_s: float, lost: Mapping[str, int]) -> None:
        """Add messages that were lost between two looks, the last of them at `to_s`.

        Looks at most two seconds apart are exact enough: the second of `to_s` gets them all. Otherwise, the
        messages are spread over the time between.
        """
        lost = {reason: count for reason, count in lost.items() if count > 0}
        if not lost:
            return
        self.total += sum(lost.values())
        span_s = to_s - from_s
        if span_s <= 2:
            self._put(0, int(to_s // 1), lost)
            return
        tier, most = 0, WIDEST_S.bit_length() - 1
        while tier < most and span_s > 16 << tier:
            tier += 1
        first, last = int(from_s // (1 << tier)), int(to_s // (1 << tier))
        first = max(first, last - MOST_EACH + 1)
        number = last - first + 1
        for place in range(number):
            part = {
                reason: count * (place + 1) // number - count * place // number
                for reason, count in lost.items()
            }
            self._put(tier, first + place, part)

    def add_earlier(self, lost: Mapping[str, int]) -> None:
        """Add messages lost before the first look: the time is not known."""
        self.total += sum(lost.values())
        _add(self.earlier, lost)

    def _put(self, tier: int, number: int, lost: Mapping[str, int]) -> None:
        lost = {reason: count for reason, count in lost.items() if count}
        if not lost:
            return
        while len(self._tiers) <= tier:
            self._tiers.append({})
        slots = self._tiers[tier]
        self.newest_s = max(self.newest_s, (number + 1) << tier)
        slot = slots.get(number)
        if slot is not None:
            _add(slot, lost)
            return
        slots[number] = _bounded(lost)
        if len(slots) > MOST_EACH:
            oldest = min(slots)
            old = slots.pop(oldest)
            if 1 << (tier + 1) > WIDEST_S:
                _add(self.earlier, old)
            else:
                self._put(tier + 1, oldest // 2, old)

    @classmethod
    def of(cls, slots: Iterable[Slot], earlier: Mapping[str, int] | None = None) -> "LossTimeline":
        """A timeline with these slots, such as those of a bag. Raises ValueError for a width or count that a
        timeline does not have."""
        found = cls()
        for slot in sorted(slots, key=lambda one: one.at_s):
            tier = slot.width_s.bit_length() - 1
            if not 1 <= slot.width_s <= WIDEST_S or slot.width_s != 1 << tier or slot.at_s % slot.width_s:
                raise ValueError(f"no slot of a timeline: {slot.width_s} s from second {slot.at_s} on")
            if min(slot.lost.values(), default=0) < 0:
                raise ValueError(f"a slot with a negative count, from second {slot.at_s} on")
            found.total += slot.count
            found._put(tier, slot.at_s // slot.width_s, slot.lost)
        found.add_earlier(earlier or {})
        return found

    def __bool__(self) -> bool:
        return self.total > 0

    def __len__(self) -> int:
        """How many slots it has."""
        return sum(map(len, self._tiers))

    def slots(self, since_s: float | None = None) -> list[Slot]:
        """The slots by time; with `since_s`, those that end after it."""
        return sorted(self._slots(since_s), key=lambda one: (one.at_s, one.width_s))

    def _slots(self, since_s: float | None) -> Iterator[Slot]:
        for tier, slots in enumerate(self._tiers):
            width_s = 1 << tier
            if since_s is not None and (not slots or (max(slots) + 1) * width_s <= since_s):
                continue
            for number, lost in slots.items():
                if since_s is None or (number + 1) * width_s > since_s:
                    yield Slot(number * width_s, width_s, dict(lost))

    @property
    def lost(self) -> dict[str, int]:
        """All losses by reason."""
        total = dict(self.earlier)
        for slots in self._tiers:
            for lost in slots.values():
                _add(total, lost)
        return total

    def bursts(self, most: int, pause_s: int = 2) -> list[Burst]:
        """The newest bursts, at most so many, the newest last. A burst ends after `pause_s` without a
        loss."""
        found: list[Burst] = []
        for slot in self.slots():
            if found and slot.at_s - (found[-1].at_s + found[-1].span_s) < pause_s:
                last = found[-1]
                lost = dict(last.lost)
                _add(lost, slot.lost)
                end_s = max(last.at_s + last.span_s, slot.at_s + slot.width_s)
                found[-1] = Burst(last.at_s, end_s - last.at_s, lost)
            else:
                found.append(Burst(slot.at_s, slot.width_s, slot.lost))
        return found[-most:]

    def bars(self, begin_s: float, end_s: float, number: int, reason: str | None = None) -> list[float]:
        """Messages lost in each of `number` equal parts of a time, for all reasons or one.

        A slot that touches several parts counts in each by its share.
        """
        bars = [0.0] * number
        part_s = (end_s - begin_s) / number
        for tier, slots in enumerate(self._tiers):
            width_s = 1 << tier
            if not slots or (max(slots) + 1) * width_s <= begin_s:
                continue
            for slot, lost in slots.items():
                at_s = slot * width_s
                count = sum(lost.values()) if reason is None else lost.get(reason, 0)
                ended_s = at_s + width_s
                first = int((at_s - begin_s) // part_s)
                if 0 <= first < number and ended_s <= begin_s + (first + 1) * part_s:
                    bars[first] += count
                    continue
                for place in range(max(0, first), number):
                    began_s = begin_s + place * part_s
                    shared_s = min(began_s + part_s, ended_s) - max(began_s, at_s)
                    if shared_s <= 0:
                        break
                    bars[place] += count * shared_s / width_s
        return bars


def _add(total: dict[str, int], lost: Mapping[str, int]) -> None:
    for reason, count in lost.items():
        if not count:
            continue
        name = reason if reason in total or len(total) < _MOST_REASONS else _OTHER
        total[name] = total.get(name, 0) + count


def _bounded(lost: Mapping[str, int]) -> dict[str, int]:
    found: dict[str, int] = {}
    _add(found, lost)
    return found

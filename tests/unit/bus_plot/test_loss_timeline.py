"""When messages were lost: the sums stay right, the bound holds, and the newest losses are exact."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_plot.loss_timeline import MOST_EACH, WIDEST_S, Burst, LossTimeline, Slot

MOST_SLOTS = MOST_EACH * WIDEST_S.bit_length()


def test_losses_of_one_second_are_one_slot() -> None:
    timeline = LossTimeline()
    assert not timeline
    timeline.add(9.1, 10.1, {"replaced": 3, "expired": 0})
    timeline.add(10.1, 10.9, {"replaced": 2, "expired": 1})
    timeline.add(10.9, 11.9, {})
    timeline.add(11.9, 12.9, {"replaced": 4})
    assert timeline
    assert timeline.slots() == [Slot(10, 1, {"replaced": 5, "expired": 1}), Slot(12, 1, {"replaced": 4})]
    assert timeline.slots(11) == [Slot(12, 1, {"replaced": 4})]
    assert timeline.lost == {"replaced": 9, "expired": 1}


def test_losses_between_distant_looks_are_spread_and_none_is_left_out() -> None:
    timeline = LossTimeline()
    timeline.add(100.0, 110.0, {"replaced": 1000})
    slots = timeline.slots()
    assert (slots[0].at_s, slots[-1].at_s, len(slots)) == (100, 110, 11)
    assert {slot.count for slot in slots} <= {90, 91}
    assert timeline.lost == {"replaced": 1000}
    timeline.add(110.0, 110.0 + 3600, {"replaced": 7})
    assert timeline.lost == {"replaced": 1007}
    assert {slot.width_s for slot in timeline.slots(111.0)} == {256}


def test_the_past_becomes_less_exact_and_the_newest_minute_stays_exact() -> None:
    timeline = LossTimeline()
    for second in range(1000):
        timeline.add(second - 1, second, {"replaced": 2})
    slots = timeline.slots()
    assert [slot.at_s for slot in slots if slot.width_s == 1] == list(range(940, 1000))
    assert [slot.width_s for slot in slots if slot.width_s == 2][:1] == [2]
    ends = [slot.at_s + slot.width_s for slot in slots]
    assert slots[0].at_s == 0
    assert all(slot.at_s <= end for slot, end in zip(slots[1:], ends, strict=False)), "there is no hole"
    assert timeline.lost == {"replaced": 2000}


def test_seldom_losses_stay_exact_for_hours() -> None:
    timeline = LossTimeline()
    for hour in range(50):
        timeline.add(hour * 3600 - 1, hour * 3600, {"replaced": 1})
    assert [slot.at_s for slot in timeline.slots()] == [hour * 3600 for hour in range(50)]
    assert {slot.width_s for slot in timeline.slots()} == {1}


def test_the_bound_of_slots_and_of_reasons() -> None:
    timeline = LossTimeline()
    seconds = 40 * 3600
    for second in range(seconds):
        timeline.add(second - 1, second, {"replaced": 1})
    assert len(timeline) <= MOST_SLOTS == 660
    assert timeline.earlier["replaced"] > 0
    assert timeline.lost == {"replaced": seconds}
    for number in range(100):
        timeline.add(seconds, seconds, {f"reason_{number}": 1})
    assert len(timeline.slots()[-1].lost) <= 17
    assert sum(timeline.lost.values()) == seconds + 100


def test_losses_of_an_unknown_time() -> None:
    timeline = LossTimeline()
    timeline.add_earlier({"replaced": 5})
    timeline.add_earlier({"replaced": 2})
    assert timeline
    assert (timeline.slots(), timeline.earlier, timeline.lost) == ([], {"replaced": 7}, {"replaced": 7})


def test_bars_share_the_slots() -> None:
    timeline = LossTimeline.of([Slot(8, 4, {"replaced": 8}), Slot(20, 1, {"replaced": 3})], {"expired": 1})
    assert timeline.bars(0, 24, 6) == [0, 0, 8, 0, 0, 3]
    assert timeline.bars(8, 12, 4) == [2, 2, 2, 2]
    assert timeline.bars(8, 12, 4, "expired") == [0, 0, 0, 0]
    assert timeline.bars(8, 12, 2, "replaced") == [4, 4]
    assert timeline.bars(10, 14, 2) == [4, 0], "half of the slot is before the first bar"
    assert timeline.bars(20.5, 30.5, 2) == [1.5, 0]
    assert timeline.lost == {"replaced": 11, "expired": 1}


def test_bursts_end_with_a_pause() -> None:
    timeline = LossTimeline()
    for second in (10, 11, 13, 16, 40):
        timeline.add(second - 1, second, {"replaced": second, "expired": second % 2})
    assert timeline.bursts(9) == [
        Burst(10, 4, {"replaced": 34, "expired": 2}),
        Burst(16, 1, {"replaced": 16}),
        Burst(40, 1, {"replaced": 40}),
    ]
    assert timeline.bursts(1) == [Burst(40, 1, {"replaced": 40})]


@pytest.mark.parametrize(
    "slot",
    [
        Slot(0, 3, {"a": 1}),
        Slot(1, 2, {"a": 1}),
        Slot(0, 2048, {"a": 1}),
        Slot(0, 0, {}),
        Slot(0, 1, {"a": -1}),
    ],
)
def test_what_is_no_slot(slot: Slot) -> None:
    with pytest.raises(ValueError, match="slot"):
        LossTimeline.of([slot])


@given(st.lists(st.tuples(st.floats(0, 5000), st.integers(0, 1000)), max_size=80))
def test_no_loss_leaves_and_slots_come_back_alike(steps: list[tuple[float, int]]) -> None:
    timeline, now_s = LossTimeline(), 0.0
    for pause_s, count in steps:
        timeline.add(now_s, now_s + pause_s, {"replaced": count})
        now_s += pause_s
    total = sum(count for _, count in steps)
    assert sum(timeline.lost.values()) == total
    assert len(timeline) <= MOST_SLOTS
    again = LossTimeline.of(timeline.slots(), timeline.earlier)
    assert (again.slots(), again.earlier) == (timeline.slots(), timeline.earlier)
    timed = sum(slot.count for slot in timeline.slots())
    assert sum(timeline.bars(0, now_s + WIDEST_S, 37)) == pytest.approx(timed)

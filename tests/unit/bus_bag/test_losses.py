"""The accounts of a recording."""

import pytest

from bus.vocabulary import DropReason
from bus_bag.losses import LossDates, TopicLosses, from_record, lines, to_record
from bus_plot.loss_timeline import Slot


def test_there_and_back() -> None:
    topics = {"/a": TopicLosses(10, 7, 0, {"replaced": 3}), "/b": TopicLosses(2, 2)}
    record = to_record(topics)
    assert record == {
        "/a": '{"expected":10,"written":7,"lost":{"replaced":3}}',
        "/b": '{"expected":2,"written":2}',
    }
    assert from_record(record) == topics
    with pytest.raises(ValueError, match="expected"):
        from_record({"/a": "{}"})


def test_the_dates_of_losses() -> None:
    dates = LossDates()
    for now_s, lost in (
        (100.0, {}),
        (100.9, {"replaced": 2}),
        (101.8, {"replaced": 2}),
        (102.7, {"replaced": 5}),
    ):
        found = dates.note(now_s, {"/a": TopicLosses(9, 9, 0, dict(lost)), "/b": TopicLosses(2, 2)})
    assert found["/a"].when == [Slot(100, 1, {"replaced": 2}), Slot(102, 1, {"replaced": 3})]
    assert found["/b"] == TopicLosses(2, 2)
    record = to_record(found)
    assert record["/a"].endswith('"when":[[100,1,{"replaced":2}],[102,1,{"replaced":3}]]}')
    assert from_record(record) == found
    assert found["/a"].timeline.lost == {"replaced": 5}
    first = LossDates().note(7.5, {"/a": TopicLosses(9, 8, 0, {"replaced": 1})})
    assert first["/a"].when == [Slot(7, 1, {"replaced": 1})], "the recording has just begun"


def _slots(losses: TopicLosses) -> list[tuple[int, int]]:
    return [(slot.at_s, slot.count) for slot in losses.when]


def test_what_was_missed_while_busd_was_away_is_spread_over_its_absence() -> None:
    """Also if the publisher returns later than busd. A topic that goes on meanwhile has its own times."""
    dates = LossDates()
    looks = [
        (100.0, False, 50, {}),
        (100.9, True, 50, {}),
        (101.8, True, 50, {"replaced": 1}),
        (102.7, True, 50, {"replaced": 1}),
        (103.6, False, 50, {"replaced": 1}),
        (104.5, False, 110, {"replaced": 1, "disconnected": 50}),
        (110.5, False, 120, {"replaced": 1, "disconnected": 50}),
        (111.4, False, 130, {"replaced": 1, "disconnected": 55}),
    ]
    for now_s, is_away, expected, lost in looks:
        found = dates.note(now_s, {"/a": TopicLosses(expected, 0, 0, lost)}, is_away=is_away)
    assert _slots(found["/a"]) == [(100, 10), (101, 11), (102, 10), (103, 10), (104, 10), (111, 5)]
    assert found["/a"].timeline.lost == {"replaced": 1, "disconnected": 55}


def test_losses_with_a_known_time_are_not_dated_by_the_look() -> None:
    dates = LossDates()
    dates.note(100.0, {"/a": TopicLosses(1, 1)})
    dates.add("/a", 97, DropReason.RECORDER_CACHE, 2)
    dates.add("/a", 98, DropReason.RECORDER_CACHE, 1)
    found = dates.note(100.9, {"/a": TopicLosses(9, 5, 0, {"recorder_cache": 3, "replaced": 1})})
    assert _slots(found["/a"]) == [(97, 2), (98, 1), (100, 1)]
    again = dates.note(101.8, {"/a": TopicLosses(9, 5, 0, {"recorder_cache": 3, "replaced": 1})})
    assert again == found


def test_they_close() -> None:
    open_one = TopicLosses(10, 5, 2, {"replaced": 3})
    assert open_one.is_balanced
    assert open_one.closed() == TopicLosses(10, 5, 0, {"replaced": 3, "unexplained": 2})
    assert not TopicLosses(10, 5).is_balanced
    whole = TopicLosses(3, 3)
    assert whole.closed() is whole


def test_lines_only_where_something_is_missing() -> None:
    topics = {"/b": TopicLosses(10, 7, 0, {"replaced": 2, "recorder_cache": 1}), "/a": TopicLosses(2, 2)}
    assert list(lines(topics)) == ["/b: 3 of 10 (recorder_cache: 1, replaced: 2)"]

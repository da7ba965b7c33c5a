"""The accounts of a recording."""

import pytest

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

"""The accounts of a recording."""

import pytest

from bus_bag.losses import TopicLosses, from_record, lines, to_record


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

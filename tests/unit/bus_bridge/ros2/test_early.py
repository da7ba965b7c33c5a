"""bus_bridge.ros2.early: samples kept until a reader carries them."""

import pytest

from bus_bridge.ros2 import early as early_module
from bus_bridge.ros2.early import Arrived, Early

OF_ONE, OF_OTHER = 1, 2


def data(early: Early[int, Arrived], handle: int) -> list[bytes]:
    messages, _ = early.pop(handle)
    return [data for data, _ in messages]


def test_what_came_of_each_writer_is_given_once_and_in_order() -> None:
    early: Early[int, Arrived] = Early(10, 1000)
    assert [early.put(OF_ONE, (b"a", 1)), early.put(OF_OTHER, (b"b", 1)), early.put(OF_ONE, (b"c", 2))] == [
        True,
        True,
        False,
    ]
    assert [*early] == [OF_ONE, OF_OTHER] and len(early) == 3
    messages, lost = early.pop(OF_ONE)
    assert ([*messages], dict(lost)) == ([(b"a", 1), (b"c", 2)], {})
    assert data(early, OF_ONE) == [] and data(early, OF_OTHER) == [b"b"]
    assert early.put(OF_ONE, (b"d", 3))


def test_beyond_the_depth_the_oldest_go_and_are_counted() -> None:
    early: Early[int, Arrived] = Early(3, 1000)
    for number in range(5):
        early.put(OF_ONE, (bytes([number]), number))
    early.put(OF_OTHER, (b"b", 1))
    messages, lost = early.pop(OF_ONE)
    assert ([time_ns for _, time_ns in messages], lost) == ([2, 3, 4], {"replaced": 2})
    assert early.pop(OF_OTHER)[1] == {}


def test_beyond_the_bytes_the_oldest_of_that_writer_go() -> None:
    early: Early[int, Arrived] = Early(10, 10)
    early.put(OF_OTHER, (b"1234", 1))
    for byte in b"abc":
        early.put(OF_ONE, (3 * bytes([byte]), 1))
    messages, lost = early.pop(OF_ONE)
    assert ([data for data, _ in messages], lost) == ([b"bbb", b"ccc"], {"memory_limit": 1})
    assert data(early, OF_OTHER) == [b"1234"]
    early.put(OF_ONE, (b"1234567890", 1))  # all of its room is free again
    assert len(early) == 1


def test_without_a_depth_there_are_as_many_as_have_room() -> None:
    early: Early[int, Arrived] = Early(None, 10_000)
    for number in range(10_002):
        early.put(OF_ONE, (b"x", number))
    early.put(OF_OTHER, (b"y", 1))  # no room is left for it
    messages, lost = early.pop(OF_ONE)
    assert ([time_ns for _, time_ns in messages], lost) == ([*range(2, 10_002)], {"memory_limit": 2})
    messages, lost = early.pop(OF_OTHER)
    assert ([*messages], lost) == ([], {"memory_limit": 1})


def test_there_is_a_bound_for_messages_without_content_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(early_module, "_MOST_MESSAGES", 3)
    early: Early[int, Arrived] = Early(None, 100)
    early.put(OF_OTHER, (b"", 1))
    for number in range(4):
        early.put(OF_ONE, (b"", number))
    messages, lost = early.pop(OF_ONE)
    assert ([time_ns for _, time_ns in messages], lost) == ([2, 3], {"memory_limit": 2})
    assert len(early) == 1
    for number in range(2):
        early.put(OF_ONE, (b"", number))
    assert (len(early), early.pop(OF_ONE)[1]) == (3, {})


def test_all_of_it_may_be_forgotten() -> None:
    early: Early[int, Arrived] = Early(None, 1)
    early.put(OF_ONE, (b"x", 1))
    early.clear()
    assert [*early] == [] and early.put(OF_ONE, (b"y", 1)) and data(early, OF_ONE) == [b"y"]


def test_the_number_of_writers_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(early_module, "_MOST_HANDLES", 3)
    early: Early[int, Arrived] = Early(None, 10)
    for handle in range(8):  # some of them have no room for a message
        early.put(handle, (b"1234", 1))
    assert [*early] == [5, 6, 7]
    assert [data(early, handle) for handle in range(4, 8)] == [[], [], [b"1234"], [b"1234"]]
    early.put(8, (b"1234567890", 1))  # all of its room is free again
    assert len(early) == 1

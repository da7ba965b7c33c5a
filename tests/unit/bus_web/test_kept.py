"""Messages kept for late viewers: their bound, and drops if there is no room."""

from typing import Any

from bus_web import kept as module
from bus_web.kept import Kept, One

INFO: Any = None


def one(number: int, size: int = 0) -> One:
    return One(bytes(size), INFO, number)


def numbers(kept: Kept, topic: str = "/t") -> list[int]:
    return [each.number for each in kept.of_topic(topic)]


def test_each_publisher_s_last_in_the_order_in_which_they_came() -> None:
    kept = Kept()
    for number, gid in enumerate((b"a", b"b", b"a", b"a")):
        kept.put("/t", gid, one(number), depth=2)
    kept.put("/other", b"a", one(9), depth=2)
    assert (numbers(kept), numbers(kept, "/other")) == ([1, 2, 3], [9])
    kept.retain("/t", {b"b"})
    assert (numbers(kept), numbers(kept, "/other"), numbers(kept, "/none")) == ([1], [9], [])
    kept.retain("/t", ())
    kept.retain("/other", ())
    assert (kept.bytes, kept._topics, kept._queues) == (0, {}, {})


def test_who_keeps_much_loses_and_who_keeps_little_does_not() -> None:
    most = 100 * (1000 + module._EACH)
    kept = Kept(most)
    kept.put("/t", b"little", one(0), depth=5)
    for number in range(1, 1000):
        kept.put("/t", b"much%d" % (number % 20), one(number, 1000), depth=200)
        assert kept.bytes <= most
    found = numbers(kept)
    assert found[0] == 0
    assert found[-1] == 999
    assert 70 <= len(found) <= 101
    assert kept.dropped == 1000 - len(found)


def test_one_that_is_larger_than_all_there_is_room_for() -> None:
    kept = Kept(10_000)
    kept.put("/t", b"little", one(0), depth=5)
    kept.put("/huge", b"h", one(1, 20_000), depth=5)
    assert (numbers(kept), numbers(kept, "/huge")) == ([0], [])
    assert kept.bytes == module._EACH


def test_room_is_not_searched_for_each_time() -> None:
    """With thousands of publishers that keep as much as they can, each message would cost a search."""
    kept = Kept(1000 * 1500)
    for number in range(1000):
        kept.put("/t", b"%d" % number, one(number, 1000), depth=1)
    kept.put("/t", b"more", one(1000, 1000), depth=1)
    assert kept.bytes <= 750 * 1500

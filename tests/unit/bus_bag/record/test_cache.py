"""Messages that wait for the disk, and drops if the cache is full."""

from typing import TypeVar

from hypothesis import given
from hypothesis import strategies as st

from bus_bag.record.cache import Cache

T = TypeVar("T")


def drain(cache: Cache[T]) -> list[T]:
    found = []
    while cache.waiting:
        found.append(cache.take()[1])
    return found


def test_in_the_order_in_which_it_came() -> None:
    cache: Cache[str] = Cache(100)
    cache.put("a", "1", 1, 10)
    cache.put("b", "2", 1, 10)
    cache.put("a", "3", 2, 10)
    assert (cache.bytes, cache.waiting) == (30, 3)
    assert cache.peek() == "1"
    assert cache.take() == ("a", "1", 1)
    assert drain(cache) == ["2", "3"]
    assert (cache.bytes, cache.waiting, cache.lost) == (0, 0, {})


def test_the_topic_with_most_bytes_loses_its_oldest() -> None:
    cache: Cache[str] = Cache(100)
    cache.put("tf", "t1", 3, 10)
    cache.put("camera", "c1", 1, 40)
    cache.put("camera", "c2", 2, 40)
    cache.put("tf", "t2", 1, 30)
    assert cache.lost == {("camera", 0): 1}
    assert drain(cache) == ["t1", "c2", "t2"]
    assert cache.peek() is None


def test_what_is_larger_than_all_room_has_it_alone() -> None:
    cache: Cache[str] = Cache(10)
    cache.put("camera", "c1", 1, 50)
    assert (cache.bytes, cache.lost) == (50, {})
    cache.put("camera", "c2", 1, 50)
    assert (drain(cache), cache.lost) == (["c2"], {("camera", 0): 1})


def test_an_entry_without_bytes_takes_no_room() -> None:
    cache: Cache[str] = Cache(100)
    cache.put("camera", "c1", 1, 150)
    cache.put("", "request", 0, 0, may_be_lost=False)
    assert (cache.lost, cache.waiting) == ({}, 2)
    cache.put("camera", "c2", 1, 150)
    assert (cache.lost, cache.waiting) == ({("camera", 0): 1}, 2)
    assert cache.clear() == {("camera", 0): 1}


def test_batches_that_may_not_be_lost() -> None:
    cache: Cache[str] = Cache(100)
    cache.put("log", "l1", 1, 90, may_be_lost=False)
    cache.put("tf", "t1", 1, 10)
    cache.put("log", "l2", 1, 60, may_be_lost=False)
    assert (cache.bytes, cache.lost) == (150, {("tf", 0): 1})
    cache.put("camera", "c1", 2, 20)
    assert cache.lost == {("tf", 0): 1, ("camera", 0): 2}, "there is no room before the others are written"
    assert drain(cache) == ["l1", "l2"]
    cache.put("camera", "c2", 1, 120)
    assert drain(cache) == ["c2"], "there is room again"


def test_a_circular_one_loses_the_oldest_of_all() -> None:
    cache: Cache[str] = Cache(100, is_circular=True)
    cache.put("tf", "t1", 3, 10)
    cache.put("camera", "c1", 1, 80)
    cache.put("camera", "c2", 1, 15)
    assert (drain(cache), cache.lost) == (["c1", "c2"], {("tf", 0): 3})


def test_thrown_away() -> None:
    cache: Cache[str] = Cache(100)
    cache.put("a", "1", 2, 10)
    cache.put("a", "2", 3, 10)
    cache.put("b", "3", 1, 10, at_s=7)
    assert cache.clear() == {("a", 0): 5, ("b", 7): 1}
    assert not cache.waiting


def test_what_is_dropped_has_the_time_of_its_own_arrival() -> None:
    cache: Cache[str] = Cache(10)
    for at_s in (3, 3, 4, 9):
        cache.put("camera", "c", 1, 10, at_s=at_s)
    assert cache.lost == {("camera", 3): 2, ("camera", 4): 1}
    assert cache.clear() == {("camera", 9): 1}


_deeds = st.lists(
    st.one_of(st.tuples(st.sampled_from("abc"), st.integers(0, 60)), st.just(None)), max_size=300
)


@given(_deeds, st.integers(0, 100), st.booleans(), st.sampled_from(["", "c"]))
def test_nothing_is_lost_without_being_counted(
    deeds: list[tuple[str, int] | None], limit: int, is_circular: bool, lossless: str
) -> None:
    lossless = "" if is_circular else lossless
    cache: Cache[int] = Cache(limit, is_circular=is_circular)
    put, taken = 0, []
    for deed in deeds:
        if deed is None:
            if cache.waiting:
                taken.append(cache.take()[1])
        else:
            cache.put(deed[0], put, 1, deed[1], may_be_lost=deed[0] != lossless)
            put += 1
    taken += drain(cache)
    assert taken == sorted(taken)
    assert len(taken) + sum(cache.lost.values()) == put
    assert cache.bytes == 0
    assert (lossless, 0) not in cache.lost

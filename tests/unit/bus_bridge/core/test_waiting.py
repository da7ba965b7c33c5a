from collections.abc import Iterable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.batch import Loose, Sample
from bus_bridge.core import waiting as waiting_module
from bus_bridge.core.waiting import RateLimit, Waiting
from bus_bridge.packed import RECORD, Packed
from rows import for_each

_S = 1_000_000_000


def samples(*numbers: int, size: int = 1) -> Loose:
    return Loose([Sample(bytes(size), number, number) for number in numbers])


def packed(some: Iterable[Sample]) -> Packed:
    data = b"".join(
        RECORD.pack(one.number, one.source_time_ns, len(one.payload)) + one.payload for one in some
    )
    found = Packed.read(data, 1 << 62)
    assert found is not None
    return found


def numbers(waiting: Waiting) -> list[int]:
    return [one.number for one in waiting.first(1000) or ()]


def test_the_oldest_go_beyond_the_depth() -> None:
    waiting = Waiting(1000)
    assert waiting.put(samples(1, 2, 3), 2) == (1, 0)
    assert numbers(waiting) == [2, 3]
    assert waiting.put(samples(4, 5, 6), 2) == (3, 0)
    assert numbers(waiting) == [5, 6]


def test_without_a_depth_all_stay() -> None:
    waiting = Waiting(1 << 20)
    assert waiting.put(samples(*range(5000)), None) == (0, 0)
    assert waiting.count == 5000


def test_the_oldest_go_beyond_the_bytes_but_never_the_last() -> None:
    waiting = Waiting(100)
    assert waiting.put(samples(1, 2, size=60), 10) == (0, 1)
    assert numbers(waiting) == [2]
    assert waiting.put(samples(3, size=500), 10) == (0, 1)
    assert numbers(waiting) == [3]
    assert waiting.bytes == 500


def test_there_is_a_bound_for_messages_without_content_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waiting_module, "_MOST_MESSAGES", 3)
    waiting = Waiting(100)
    assert waiting.put(samples(1, 2, 3, size=0), None) == (0, 0)
    assert waiting.put(samples(4, size=0), None) == (0, 1)
    assert waiting.put(packed(samples(5, 6, 7, 8, 9, size=0)), 4) == (4, 1)
    assert numbers(waiting) == [7, 8, 9]


def test_what_has_gone_on_is_forgotten() -> None:
    waiting = Waiting(100)
    waiting.put(samples(1, 2, 3, size=10), 10)
    assert [one.number for one in waiting.first(2) or ()] == [1, 2]
    waiting.remove(2)
    assert (numbers(waiting), waiting.bytes) == ([3], 10)
    assert waiting.clear() == 1
    assert (waiting.count, waiting.bytes) == (0, 0)


class Model:
    """A model that keeps each message by itself."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self.kept: list[Sample] = []

    def put(self, some: Sequence[Sample], depth: int | None) -> tuple[int, int]:
        self.kept += some
        replaced = 0 if depth is None else max(0, len(self.kept) - depth)
        del self.kept[:replaced]
        over = 0
        while sum(len(one.payload) for one in self.kept) > self.max_bytes and len(self.kept) > 1:
            del self.kept[0]
            over += 1
        return replaced, over


@given(
    st.lists(
        st.tuples(st.integers(1, 9), st.booleans(), st.sampled_from([None, 1, 5, 20]), st.integers(0, 9))
    )
)
def test_what_came_packed_waits_as_what_did_not(steps: list[tuple[int, bool, int | None, int]]) -> None:
    waiting, model, number = Waiting(100), Model(100), 0
    for count, is_packed, depth, gone in steps:
        some = [Sample(bytes(one), number + one, one) for one in range(1, count + 1)]
        number += count
        assert waiting.put(packed(some) if is_packed else Loose(some), depth) == model.put(some, depth)
        first = list(waiting.first(4) or ())
        assert first == model.kept[: len(first)] and bool(first) is bool(model.kept)
        gone = min(gone, len(model.kept))
        waiting.remove(gone)
        del model.kept[:gone]
        assert waiting.count == len(model.kept)
        assert waiting.bytes == sum(len(one.payload) for one in model.kept)


@for_each(
    "hz, sent_hz, passing",
    [(10.0, 100, 10), (10.0, 30, 10), (10.0, 10, 10), (10.0, 5, 5), (1.0, 1000, 1), (30.0, 50, 30)],
)
def test_the_rate_is_that_of_the_rule(hz: float, sent_hz: int, passing: int) -> None:
    limit = RateLimit(hz)
    sent = [Sample(b"", number, 100 * _S + number * _S // sent_hz) for number in range(10 * sent_hz)]
    assert abs(len(limit.passing(sent)) - 10 * passing) <= 1


def test_a_timer_that_is_a_little_early_loses_nothing() -> None:
    limit = RateLimit(10.0)
    sent = [Sample(b"", n, 100 * _S + n * _S // 10 + (-1) ** n * 2_000_000) for n in range(100)]
    assert len(limit.passing(sent)) == 100


def test_after_a_pause_or_with_a_clock_that_was_set_the_next_one_passes() -> None:
    limit = RateLimit(1.0)
    times = [100 * _S, 100 * _S + 1, 1000 * _S, 1000 * _S + 1, 50 * _S, 50 * _S + 1, 51 * _S]
    passing = limit.passing([Sample(b"", number, time) for number, time in enumerate(times)])
    assert [one.number for one in passing] == [0, 2, 4, 6]

"""Messages in one buffer, and the native core that reads through it."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import shm
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.packed import RECORD, Packed, scan, scan_here

_MOST = 1 << 48
_samples = st.lists(
    st.builds(Sample, st.binary(max_size=40), st.integers(0, _MOST), st.integers(-(2**63), 2**63 - 1)),
    min_size=1,
    max_size=12,
)


def data_of(samples: Sequence[Sample]) -> bytes:
    return b"".join(
        RECORD.pack(one.number, one.source_time_ns, len(one.payload)) + one.payload for one in samples
    )


def figures(batch: Batch) -> tuple[object, ...]:
    return (
        batch.count,
        batch.payload_bytes,
        batch.first_number,
        batch.last_number,
        batch.last_time_ns,
        batch.is_consecutive,
    )


def read(samples: Sequence[Sample]) -> Packed:
    found = Packed.read(data_of(samples), _MOST)
    assert found is not None
    return found


@given(_samples)
def test_it_is_as_a_list(samples: list[Sample]) -> None:
    packed = read(samples)
    assert list(packed) == samples and packed.count == len(samples)
    assert figures(packed) == figures(Loose(samples))


@given(_samples, st.integers(0, 12))
def test_what_is_left_is_one_too(samples: list[Sample], count: int) -> None:
    count = min(count, len(samples) - 1)
    rest = read(samples).after(count)
    assert list(rest) == samples[count:]
    assert rest.whole[rest.start :] == data_of(samples[count:])
    assert rest.size == len(rest.whole) - rest.start
    whole, after = Loose(samples), Loose(samples).after(count)
    assert figures(rest)[:-1] == figures(after)[:-1]
    assert rest.is_consecutive is whole.is_consecutive


def test_whether_one_is_missing_in_between() -> None:
    assert read([Sample(b"", number, 0) for number in (4, 5, 6)]).is_consecutive
    assert not read([Sample(b"", number, 0) for number in (4, 6, 7)]).is_consecutive
    assert not read([Sample(b"", number, 0) for number in (4, 4)]).is_consecutive


def test_anything_else_is_refused() -> None:
    data = data_of([Sample(b"abc", 1, 2), Sample(b"", 3, 4)])
    assert Packed.read(b"", _MOST) is None
    assert Packed.read(data[:-1], _MOST) is None
    assert Packed.read(data + b"x", _MOST) is None
    assert Packed.read(data, 2) is None
    assert Packed.read(data, 3) is not None


@given(
    _samples.map(data_of) | st.binary(max_size=200),
    st.integers(0, 60),
    st.integers(0, 4),
    st.integers(0, 9),
)
def test_the_native_core_sees_the_same(data: bytes, cut: int, start: int, limit: int) -> None:
    if not shm.has_core():
        pytest.skip("the native core was not built")
    data = data[: len(data) - cut]
    start = min(start, len(data))
    assert scan(data, start, limit) == scan_here(data, start, limit)


def test_a_start_behind_the_end() -> None:
    if not shm.has_core():
        pytest.skip("the native core was not built")
    with pytest.raises(ValueError, match="behind the end"):
        scan(b"abc", 4, 1)

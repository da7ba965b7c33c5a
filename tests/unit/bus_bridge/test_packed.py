"""Messages in one buffer, and the native core that looks through it."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import shm
from bus_bridge.engine import Sample
from bus_bridge.packed import RECORD, Packed, number_and_time, payload_bytes, scan, scan_here

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


def read(samples: Sequence[Sample]) -> Packed:
    found = Packed.read(data_of(samples), _MOST)
    assert found is not None
    return found


@given(_samples, st.integers(0, 12))
def test_it_is_as_a_list(samples: list[Sample], count: int) -> None:
    packed = read(samples)
    assert list(packed) == samples and len(packed) == len(samples)
    assert [packed[index] for index in range(len(samples))] == samples
    assert (packed[0], packed[-1]) == (samples[0], samples[-1])
    for one in (packed, samples):
        assert number_and_time(one, 0) == samples[0][1:]
        assert number_and_time(one, -1) == samples[-1][1:]
    assert list(packed[:count]) == samples[:count]
    assert list(packed[count:]) == samples[count:]
    assert payload_bytes(packed) == payload_bytes(samples) == sum(len(one.payload) for one in samples)
    assert payload_bytes(packed[count:]) == payload_bytes(samples[count:])
    with pytest.raises(IndexError):
        packed[len(samples)]


@given(_samples, st.integers(0, 12))
def test_what_is_left_is_one_too(samples: list[Sample], count: int) -> None:
    count = min(count, len(samples) - 1)
    rest = read(samples).after(count)
    assert list(rest) == samples[count:] and rest[-1] == samples[-1]
    assert rest.whole[rest.start :] == rest.data == data_of(samples[count:])
    assert rest.size == len(rest.data) and number_and_time(rest, 0) == samples[count][1:]


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

"""Messages in puts."""

from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.engine import Sample
from bus_bridge.zenoh import records
from bus_bridge.zenoh.records import BATCH_BYTES

_samples = st.lists(
    st.builds(
        Sample,
        st.integers(0, 3 * BATCH_BYTES // 2).map(bytes) | st.binary(max_size=100),
        st.integers(0, 2**64 - 1),
        st.integers(-(2**63), 2**63 - 1),
    ),
    max_size=20,
)


@given(_samples, st.none() | st.integers(0, 2**64 - 1))
def test_what_is_packed_comes_out_in_order(samples: list[Sample], previous: int | None) -> None:
    found: list[Sample] = []
    before = previous
    for payload, attachment in records.pack(samples, previous):
        unpacked = records.unpack(payload, attachment, marked=previous is not None)
        assert unpacked is not None
        if previous is not None:
            assert unpacked[1] == before
            before = unpacked[0][-1].number
        assert len(payload) <= BATCH_BYTES or len(unpacked[0]) == 1
        found += unpacked[0]
    assert found == samples


def test_small_messages_share_a_put_and_a_large_one_is_not_copied() -> None:
    large = bytes(100_000)
    puts = list(
        records.pack([Sample(b"a", 1, 5), Sample(b"b", 2, 6), Sample(large, 3, 7), Sample(b"c", 4, 8)])
    )
    assert len(puts) == 3
    assert puts[1].payload is large
    assert records.count(*puts[0], marked=False) == 2


def test_a_probe_is_no_message() -> None:
    probe = records.probe(7)
    assert records.is_probe(*probe)
    assert records.unpack(*probe, marked=True) == ([], 7)
    assert not records.is_probe(b"x", b"12345678")


def test_words_and_numbers() -> None:
    assert records.read_word(records.write_word(2**64 - 1, 3)) == (2**64 - 1, 3)
    assert records.read_word(b"x") is None
    assert records.read_number(records.write_number(9)) == 9
    assert records.read_number(b"") is None


def test_a_size_beyond_the_end_is_refused() -> None:
    (put,) = records.pack([Sample(b"abc", 1, 2)])
    assert records.unpack(put.payload[:-1], None, marked=False) is None
    assert records.unpack(put.payload + b"x", None, marked=False) is None
    assert records.count(put.payload[:-1], None, marked=False) == 0


@given(st.binary(max_size=200), st.none() | st.binary(max_size=40), st.booleans())
def test_random_bytes_get_no_further_than_none(
    payload: bytes, attachment: bytes | None, marked: bool
) -> None:
    found = records.unpack(payload, attachment, marked=marked)
    assert found is None or sum(len(one.payload) for one in found[0]) <= len(payload)

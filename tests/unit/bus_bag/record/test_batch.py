"""Messages in one buffer, and the same one by one."""

import pytest

from bus import shm
from bus.subscription import MessageInfo
from bus_bag.record.batch import Packed, Sample, Samples
from packing import pack_of
from rows import for_each

pytestmark = pytest.mark.skipif(not shm.has_core(), reason="BUS_NATIVE=no")

SAMPLES: list[Sample] = [
    (bytes([number]) * number, MessageInfo(1000 + number, 5000, 7 + number, 0, b"gid")) for number in range(6)
]


@for_each("newest", [0, 1, 2, 5, 6, 7, 1000])
def test_the_newest_messages(newest: int) -> None:
    batch = Packed(pack_of(SAMPLES))
    assert batch.samples(newest) == SAMPLES[len(SAMPLES) - min(newest, len(SAMPLES)) :]


def test_all_messages() -> None:
    batch = Packed(pack_of(SAMPLES))
    assert batch.samples() == SAMPLES
    same = Samples(SAMPLES)
    assert same.samples() == SAMPLES
    assert [(one.count, one.size, one.log_time) for one in (batch, same)] == [(6, 15, 5000)] * 2


def test_another_log_time() -> None:
    batch = Packed(pack_of(SAMPLES), 6000)
    assert batch.log_time == 6000
    assert {info.received_timestamp for _, info in batch.samples()} == {6000}


def test_a_false_time_is_not_negative() -> None:
    """The stamps of a hostile publisher may be anything; a file has 64 bits without a sign."""
    (sample,) = Packed(pack_of([(b"", MessageInfo(-1, 1, 1, 0, b""))])).samples()
    assert sample[1].source_timestamp == 2**64 - 1

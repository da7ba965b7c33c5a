"""bus.wire.layout: sizes and offsets, as in the picture of its docstring."""

import pytest

from bus.wire import layout
from busd.core.limits import Limits


def test_sizes() -> None:
    assert layout.FRAME_HEAD_BYTES == 8
    assert layout.DATA_HEAD_BYTES == 32
    assert layout.RECORD_HEAD_BYTES == 12


def test_a_frame_head_is_little_endian() -> None:
    assert layout.FRAME_HEAD.pack(0x01020304, 5, 6, 0x0708) == bytes([4, 3, 2, 1, 5, 6, 8, 7])


def test_a_data_head_begins_with_a_frame_head() -> None:
    head = layout.DATA_HEAD.pack(100, layout.DATA, layout.REPLAY, 0, 1, 2, 3, 4, 0)
    assert head[: layout.FRAME_HEAD_BYTES] == layout.FRAME_HEAD.pack(100, layout.DATA, layout.REPLAY, 0)
    fields = {8: 1, 12: 2, 16: 3, 24: 4, 28: 0}
    for offset, value in fields.items():
        assert head[offset] == value


def test_a_record_head_has_a_signed_stamp() -> None:
    assert layout.RECORD_HEAD.pack(2, -1) == b"\x02\0\0\0" + b"\xff" * 8


def test_the_longest_run_fits_the_length_field() -> None:
    longest = layout.MAX_MESSAGE_BYTES + layout.RECORD_HEAD_BYTES + layout.RUN_BYTES
    assert layout.DATA_HEAD_BYTES + longest < 2**32


def test_no_configuration_allows_a_longer_message_than_the_wire() -> None:
    most = layout.MAX_MESSAGE_BYTES
    room = {"queued_bytes_per_peer": 2 * most, "queued_bytes_per_user": 2 * most}
    assert Limits(message_bytes=most, **room).message_bytes == most
    with pytest.raises(ValueError, match="message_bytes"):
        Limits(message_bytes=most + 1, **room)


def test_sums_of_two_counters_fit_into_64_bits() -> None:
    assert 2 * layout.MAX_COUNT < 2**64

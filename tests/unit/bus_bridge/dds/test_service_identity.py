"""The identity of calls, as two vendors write it."""

import pytest

from bus_bridge.dds.service_identity import (
    read_answer,
    read_request,
    write_answer,
    write_request,
)
from bus_bridge.ros2.calls import RequestId
from bus_bridge.rtps.ids import CYCLONE, FAST_DDS, reader_id, writer_id
from bus_bridge.rtps.parameters import RtpsError, read_parameters
from bus_bridge.rtps.reader import Arrived
from rows import for_each

READER, WRITER = b"\x01\x7f" + b"c" * 10 + reader_id(1), b"\x01\x7f" + b"c" * 10 + writer_id(2)
CDR = b"\0\1\0\0body"


def arrived(payload: bytes | None, inline: bytes = b"", number: int = 7, writer: bytes = WRITER) -> Arrived:
    found = read_parameters(inline, "<").parameters if inline else {}
    return Arrived(writer, number, payload, found, "<", 0)


@for_each("vendor", [FAST_DDS, CYCLONE])
def test_a_call_there_and_back(vendor: bytes) -> None:
    sample = write_request(CDR, READER, WRITER, 7, vendor)
    request, cdr = read_request(arrived(*sample), vendor)
    assert cdr == CDR and request.writer == WRITER
    assert request.reader == (READER if vendor == FAST_DDS else b"")
    answer = write_answer(request, CDR)
    assert read_answer(arrived(*answer), READER, WRITER, vendor) == (7, CDR)
    other_reader, other_writer = b"o" * 12 + reader_id(1), b"o" * 12 + writer_id(2)
    assert read_answer(arrived(*answer), other_reader, other_writer, vendor) is None


def test_the_bytes_of_fast_dds() -> None:
    """As seen on the wire of Jazzy and Kilted."""
    sample = write_request(CDR, READER, WRITER, 7, FAST_DDS)
    unknown = READER + bytes.fromhex("ffffffff00000000")
    assert sample.payload == CDR
    assert sample.inline == b"\x0f\x80\x18\0" + unknown + b"\x83\0\x18\0" + unknown + b"\1\0\0\0"


def test_the_bytes_of_cyclone() -> None:
    sample = write_request(CDR, READER, WRITER, 7, CYCLONE)
    assert sample == (b"\0\1\0\0" + WRITER[8:] + b"\7" + bytes(7) + b"body", b"")


def test_a_client_of_fast_dds_without_its_reader() -> None:
    inline = b"\x83\0\x18\0" + bytes(16) + bytes.fromhex("ffffffff00000000") + b"\1\0\0\0"
    request, _ = read_request(arrived(CDR, inline), FAST_DDS)
    assert request == RequestId(WRITER, 7, WRITER)
    assert read_answer(arrived(*write_answer(request, CDR)), READER, WRITER, FAST_DDS) == (7, CDR)


@for_each("payload, vendor", [(CDR, FAST_DDS), (CDR, CYCLONE), (None, FAST_DDS), (b"\0\1\0", CYCLONE)])
def test_without_an_identity(payload: bytes | None, vendor: bytes) -> None:
    with pytest.raises(RtpsError):
        read_request(arrived(payload), vendor)
    with pytest.raises(RtpsError):
        read_answer(arrived(payload), READER, WRITER, vendor)
    with pytest.raises(RtpsError):
        read_request(arrived(CDR, b"\x83\0\4\0abcd\1\0\0\0"), FAST_DDS)

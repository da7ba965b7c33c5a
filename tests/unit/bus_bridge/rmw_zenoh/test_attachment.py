"""bus_bridge.rmw_zenoh.attachment: the bytes of attachments, worked out by hand."""

from bus_bridge.rmw_zenoh import attachment
from bus_bridge.rmw_zenoh.attachment import Attachment
from rows import for_each

GID = bytes(range(16))
NUMBERS = bytes.fromhex("0700000000000000 00d2496b00000000")
WHOLE = Attachment(7, 1800000000, GID)


def test_what_is_written() -> None:
    assert attachment.write(7, 1800000000, GID) == NUMBERS + b"\x10" + GID


@for_each("data", [NUMBERS + b"\x10" + GID, NUMBERS + GID])
def test_both_forms_are_read(data: bytes) -> None:
    assert attachment.read(data) == WHOLE


@for_each("data", [b"", NUMBERS, NUMBERS + b"\x0f" + GID, NUMBERS + GID + b"\0\0", 40 * b"x"])
def test_what_is_no_attachment(data: bytes) -> None:
    assert attachment.read(data) is None


def test_negative_numbers_are_read_as_they_are() -> None:
    assert attachment.read(b"\xff" * 16 + b"\x10" + GID) == Attachment(-1, -1, GID)

"""The identity of the request in each request and answer, as ROS 2's middlewares write it. Pure.

Fast DDS (rmw_fastrtps, the default) has it in the inline QoS of a sample, and the payload is plain CDR:

- A request names the reader of its client's answers, without a number. The request's id is this GUID (or, if
  it is zero, the GUID of the request's writer) and the number of the request's own sample.
- An answer repeats this id.

Cyclone DDS (rmw_cyclonedds) has 16 bytes between the encapsulation and the body: an id of the client, and a
number. A server returns them as they came, in the byte order of the request.

The vendor of the far participant decides which form is used: neither understands the other one.
"""

import struct
from typing import Final, NamedTuple

from bus_bridge.ros2.calls import RequestId
from bus_bridge.rtps.ids import CYCLONE, GUID_BYTES
from bus_bridge.rtps.messages import read_number64, write_number64
from bus_bridge.rtps.parameters import RtpsError, write_parameters
from bus_bridge.rtps.reader import Arrived

__all__ = [
    "Sample",
    "read_answer",
    "read_request",
    "write_answer",
    "write_request",
]

_RELATED: Final = 0x0083
_RELATED_OLD: Final = 0x800F
"""The same parameter before it had its own number: Fast DDS still sends both."""
_NO_NUMBER: Final = -(1 << 32)
_HEAD_BYTES: Final = 4
_CYCLONE_BYTES: Final = 16
_CLIENT_BYTES: Final = 8


class Sample(NamedTuple):
    """The content of a sample to write."""

    payload: bytes
    inline: bytes = b""


def read_request(arrived: Arrived, vendor: bytes) -> tuple[RequestId, bytes]:
    """The id of a request, and its CDR. Raises RtpsError if it has none."""
    payload = _payload_in(arrived)
    if vendor == CYCLONE:
        header, cdr = _split(payload)
        return RequestId(header, 0, arrived.writer), cdr
    client, _ = _related(arrived)
    return RequestId(client if any(client) else arrived.writer, arrived.number, arrived.writer), payload


def write_answer(request: RequestId, cdr: bytes) -> Sample:
    """The answer to a request.

    For Cyclone it must have the byte order of the request: so answers are little-endian, as all requests of
    ROS 2 are.
    """
    if not request.number:
        return Sample(_joined(cdr, request.client))
    return Sample(cdr, _identity(request.client, request.number))


def write_request(cdr: bytes, reader: bytes, writer: bytes, number: int, vendor: bytes) -> Sample:
    """A request of our client, for a server of that vendor.

    `reader`: the GUID of the client's reader of answers; `writer`: the GUID of its writer of requests;
    `number`: the request's number.
    """
    if vendor == CYCLONE:
        return Sample(_joined(cdr, writer[-_CLIENT_BYTES:] + struct.pack("<q", number)))
    return Sample(cdr, _identity(reader, _NO_NUMBER))


def read_answer(arrived: Arrived, reader: bytes, writer: bytes, vendor: bytes) -> tuple[int, bytes] | None:
    """The number of the request, and the CDR of the answer; None if it is for another client.

    Raises RtpsError if there is no identity in it.
    """
    payload = _payload_in(arrived)
    if vendor == CYCLONE:
        header, cdr = _split(payload)
        if header[:_CLIENT_BYTES] != writer[-_CLIENT_BYTES:]:
            return None
        number: int = struct.unpack("<q", header[_CLIENT_BYTES:])[0]
        return number, cdr
    client, number = _related(arrived)
    return (number, payload) if client in (reader, writer) else None


def _payload_in(arrived: Arrived) -> bytes:
    payload = arrived.payload
    if payload is None or len(payload) < _HEAD_BYTES:
        raise RtpsError("a request or answer without a payload")
    return payload


def _related(arrived: Arrived) -> tuple[bytes, int]:
    values = arrived.inline.get(_RELATED) or arrived.inline.get(_RELATED_OLD)
    if not values or len(values[0]) < GUID_BYTES + 8:
        raise RtpsError("a request or answer without the identity of the request")
    return values[0][:GUID_BYTES], read_number64(values[0], GUID_BYTES, arrived.order)


def _identity(guid: bytes, number: int) -> bytes:
    value = guid + write_number64(number)
    return write_parameters([(_RELATED_OLD, value), (_RELATED, value)])


def _split(payload: bytes) -> tuple[bytes, bytes]:
    if len(payload) < _HEAD_BYTES + _CYCLONE_BYTES:
        raise RtpsError("a request or answer without the identity of the request")
    end = _HEAD_BYTES + _CYCLONE_BYTES
    return payload[_HEAD_BYTES:end], payload[:_HEAD_BYTES] + payload[end:]


def _joined(cdr: bytes, header: bytes) -> bytes:
    return cdr[:_HEAD_BYTES] + header + cdr[_HEAD_BYTES:]

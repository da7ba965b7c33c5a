"""Parameter lists of RTPS: inline QoS, and the descriptions of participants and endpoints. Pure.

Owns: the list, and the values in it: numbers, texts, durations, addresses. Must not know: which values belong
to a participant or an endpoint. Lengths in a datagram are checked against its bytes before anything is read.
"""

import ipaddress
import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

__all__ = [
    "FOREVER_NS",
    "Address",
    "Order",
    "Parameters",
    "RtpsError",
    "read_addresses",
    "read_duration_ns",
    "read_number",
    "read_octets",
    "read_parameters",
    "read_properties",
    "read_text",
    "read_texts",
    "write_address",
    "write_duration",
    "write_number",
    "write_octets",
    "write_parameters",
    "write_properties",
    "write_text",
]

Order = str
"""The order of bytes, as `struct` writes it: `<` or `>`."""
Address = tuple[str, int]
"""An IPv4 address and a UDP port."""
Parameters = Mapping[int, Sequence[bytes]]
"""Values by id. An id may occur several times."""

FOREVER_NS: Final = 2**63 - 1
"""RTPS's infinite duration, in nanoseconds."""

_SENTINEL: Final = 0x0001
_PAD: Final = 0x0000
_MOST_PARAMETERS: Final = 256
"""A longer list is refused. Fast DDS sends about 40."""
_MOST_TEXTS: Final = 64
_UDP_V4: Final = 1
_FOREVER: Final = (0x7FFF_FFFF, 0xFFFF_FFFF)
_NS_PER_S: Final = 1_000_000_000
_LOCATOR_BYTES: Final = 24


class RtpsError(ValueError):
    """Bytes that are not what RTPS allows there. The text names the rule."""


class _Read(NamedTuple):
    parameters: Parameters
    end: int
    """The offset of the first byte after the list."""


def read_parameters(data: bytes, order: Order, start: int = 0) -> _Read:
    """Read the list that begins at `start`. Raises RtpsError for a list without an end, or a bad length."""
    found: dict[int, list[bytes]] = {}
    at = start
    for _ in range(_MOST_PARAMETERS):
        if at + 4 > len(data):
            raise RtpsError("a parameter list without its end")
        key, size = struct.unpack_from(f"{order}HH", data, at)
        at += 4
        if key == _SENTINEL:
            return _Read(found, at)
        if size % 4 or size > len(data) - at:
            raise RtpsError(f"a parameter of {size} bytes, with {len(data) - at} bytes left")
        if key != _PAD:
            found.setdefault(key, []).append(bytes(data[at : at + size]))
        at += size
    raise RtpsError(f"more than {_MOST_PARAMETERS} parameters")


def write_parameters(parameters: Sequence[tuple[int, bytes]]) -> bytes:
    """The list in little-endian, with its end. Values are padded to multiples of four bytes."""
    parts = []
    for key, value in parameters:
        padded = value + bytes(-len(value) % 4)
        parts.append(struct.pack("<HH", key, len(padded)) + padded)
    parts.append(struct.pack("<HH", _SENTINEL, 0))
    return b"".join(parts)


def read_number(value: bytes, order: Order) -> int:
    """An unsigned number of four bytes. Raises RtpsError."""
    if len(value) < 4:
        raise RtpsError(f"a number of {len(value)} bytes")
    found: int = struct.unpack_from(f"{order}I", value)[0]
    return found


def write_number(value: int) -> bytes:
    return struct.pack("<I", value)


def read_octets(value: bytes, order: Order) -> bytes:
    """A counted sequence of bytes. Raises RtpsError if there are fewer bytes than its count."""
    size = read_number(value, order)
    if size > len(value) - 4:
        raise RtpsError(f"{size} bytes announced, {len(value) - 4} there")
    return value[4 : 4 + size]


def write_octets(value: bytes) -> bytes:
    return write_number(len(value)) + value


def read_text(value: bytes, order: Order) -> str:
    """A text with its length. Raises RtpsError if it is longer than its bytes, or not UTF-8."""
    try:
        return read_octets(value, order).rstrip(b"\0").decode()
    except UnicodeDecodeError:
        raise RtpsError("a text that is not UTF-8") from None


def write_text(value: str) -> bytes:
    return write_octets(value.encode() + b"\0")


def read_texts(value: bytes, order: Order) -> list[str]:
    """A counted sequence of texts. Raises RtpsError."""
    return _texts(value, order, read_number(value, order))


def read_properties(value: bytes, order: Order) -> dict[str, str]:
    """A counted sequence of pairs of texts: names and values. Raises RtpsError."""
    texts = _texts(value, order, 2 * read_number(value, order))
    return dict(zip(texts[::2], texts[1::2], strict=True))


def write_properties(properties: Sequence[tuple[str, str]]) -> bytes:
    padded = [(one + bytes(-len(one) % 4)) for pair in properties for one in map(write_text, pair)]
    return write_number(len(properties)) + b"".join(padded)


def read_duration_ns(value: bytes, order: Order) -> int:
    """A duration in nanoseconds; FOREVER_NS if it is infinite. Raises RtpsError if it is negative."""
    if len(value) < 8:
        raise RtpsError(f"a duration of {len(value)} bytes")
    seconds, fraction = struct.unpack_from(f"{order}iI", value)
    if seconds < 0:
        raise RtpsError(f"a duration of {seconds} seconds")
    if seconds == _FOREVER[0]:
        return FOREVER_NS
    return int(seconds * _NS_PER_S + (fraction * _NS_PER_S >> 32))


def write_duration(duration_ns: int) -> bytes:
    seconds, rest = divmod(duration_ns, _NS_PER_S)
    if seconds >= _FOREVER[0]:
        return struct.pack("<iI", *_FOREVER)
    return struct.pack("<iI", seconds, min(-(-(rest << 32) // _NS_PER_S), _FOREVER[1]))


def read_addresses(values: Sequence[bytes], order: Order) -> tuple[Address, ...]:
    """The addresses of UDP over IPv4 among these locators; others are passed over. Raises RtpsError."""
    found = []
    for value in values:
        if len(value) < _LOCATOR_BYTES:
            raise RtpsError(f"a locator of {len(value)} bytes")
        kind, port = struct.unpack_from(f"{order}iI", value)
        if kind == _UDP_V4 and 0 < port < 1 << 16:
            found.append((".".join(map(str, value[20:24])), port))
    return tuple(found)


def _texts(value: bytes, order: Order, count: int) -> list[str]:
    if count > _MOST_TEXTS:
        raise RtpsError(f"{count} texts; at most {_MOST_TEXTS} are allowed")
    found, at = [], 4
    for _ in range(count):
        size = read_number(value[at:], order)
        found.append(read_text(value[at:], order))
        at += 4 + size + -size % 4
    return found


def write_address(address: Address) -> bytes:
    """The locator of an address. Raises ValueError if it is not IPv4."""
    return struct.pack("<iI", _UDP_V4, address[1]) + bytes(12) + ipaddress.IPv4Address(address[0]).packed

"""Datagrams of RTPS 2.3 to submessages, and back. Pure.

Owns: the layout of datagrams and submessages. Must not know: readers, writers, the meaning of a payload.

Nothing in a datagram is trusted: lengths are checked against the received bytes, and a set of numbers has at
most 256 members. The rest of a datagram after a broken submessage is ignored. Submessages of unknown kinds
are passed over, as the standard asks.
"""

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple, TypeAlias

from bus_bridge.rtps.ids import OUR_VENDOR, PREFIX_BYTES, UNKNOWN_ENTITY, UNKNOWN_PREFIX
from bus_bridge.rtps.parameters import Order, Parameters, RtpsError, read_parameters

__all__ = [
    "HEAD_BYTES",
    "MAX_NUMBER",
    "MOST_IN_SET",
    "AckNack",
    "Data",
    "DataFragments",
    "Datagram",
    "Gap",
    "Heartbeat",
    "HeartbeatFragment",
    "NackFragments",
    "Received",
    "Submessage",
    "read_datagram",
    "read_number64",
    "write_acknack",
    "write_data",
    "write_destination",
    "write_fragment",
    "write_gap",
    "write_head",
    "write_heartbeat",
    "write_heartbeat_fragment",
    "write_nack_fragments",
    "write_number64",
    "write_time",
]

HEAD_BYTES: Final = 20
MOST_IN_SET: Final = 256
"""Numbers in the set of an ACKNACK, GAP or NACK_FRAG."""
MAX_NUMBER: Final = 2**62
"""The highest number of a sample. No writer reaches it, and the numbers after it still fit into 64 bits."""
_MOST_FRAGMENT: Final = (1 << 32) - 1

_MAGIC: Final = b"RTPS"
_VERSION: Final = b"\x02\x03"
_MOST_SUBMESSAGES: Final = 1024

_PAD, _ACKNACK, _HEARTBEAT, _GAP, _INFO_TS = 0x01, 0x06, 0x07, 0x08, 0x09
_INFO_SRC, _INFO_DST, _NACK_FRAG, _HEARTBEAT_FRAG, _DATA, _DATA_FRAG = 0x0C, 0x0E, 0x12, 0x13, 0x15, 0x16
_LITTLE: Final = 0x01
_FINAL: Final = 0x02
_INLINE: Final = 0x02
_HAS_DATA: Final = 0x04
_IS_KEY: Final = 0x08
_FRAGMENT_IS_KEY: Final = 0x04
_NO_TIME: Final = 0x02
_NS_PER_S: Final = 1_000_000_000


class Data(NamedTuple):
    """A sample, or news about one."""

    reader: bytes
    """The entity id of the addressed reader, or UNKNOWN_ENTITY."""
    writer: bytes
    number: int
    payload: bytes | None
    """With its encapsulation. None: no payload, or only the key."""
    inline: Parameters
    order: Order
    """The byte order of `inline`."""


class DataFragments(NamedTuple):
    """One or more fragments of a sample that is too long for one datagram."""

    reader: bytes
    writer: bytes
    number: int
    first: int
    """The number of the first fragment, from 1."""
    amount: int
    """Number of fragments."""
    fragment_bytes: int
    total_bytes: int
    payload: bytes
    inline: Parameters
    order: Order


class Heartbeat(NamedTuple):
    """The numbers that a writer has."""

    reader: bytes
    writer: bytes
    first: int
    last: int
    """`first` - 1: it has none."""
    serial: int
    """Rises with each of them."""
    is_final: bool
    """Whether no answer is asked for."""


class HeartbeatFragment(NamedTuple):
    """The fragments of one sample that a writer has sent so far."""

    reader: bytes
    writer: bytes
    number: int
    last_fragment: int
    serial: int
    """Rises with each of them."""


class AckNack(NamedTuple):
    """The answer of a reader: it has everything below `base`, and asks for `missing`."""

    reader: bytes
    writer: bytes
    base: int
    missing: tuple[int, ...]
    serial: int
    """Rises with each of them."""
    is_final: bool


class NackFragments(NamedTuple):
    """A reader asks for fragments of one sample."""

    reader: bytes
    writer: bytes
    number: int
    missing: tuple[int, ...]
    serial: int
    """Rises with each of them."""


class Gap(NamedTuple):
    """Numbers that a reader need not wait for: `first` to `base` - 1, and `more`."""

    reader: bytes
    writer: bytes
    first: int
    base: int
    more: tuple[int, ...]


Submessage: TypeAlias = Data | DataFragments | Heartbeat | HeartbeatFragment | AckNack | NackFragments | Gap


class Received(NamedTuple):
    """A submessage, with facts from earlier submessages of the datagram."""

    source: bytes
    """The prefix of the sending participant."""
    destination: bytes
    """The prefix of the addressed participant; UNKNOWN_PREFIX: everyone."""
    time_ns: int
    """Time of publication, wall clock; 0 if it is not there."""
    submessage: Submessage


class Datagram(NamedTuple):
    vendor: bytes
    """The vendor id of the sender."""
    received: list[Received]
    fault: str
    """The reason to ignore the rest of the datagram; empty if there is none."""


def read_datagram(data: bytes) -> Datagram:
    """Read a datagram. Raises RtpsError if it is not RTPS 2 at all."""
    if len(data) < HEAD_BYTES or data[:4] != _MAGIC or data[4] != _VERSION[0]:
        raise RtpsError("not a datagram of RTPS 2")
    source, vendor = data[8:20], data[6:8]
    destination, time_ns = UNKNOWN_PREFIX, 0
    found: list[Received] = []
    at = HEAD_BYTES
    try:
        for _ in range(_MOST_SUBMESSAGES):
            if at + 4 > len(data):
                break
            kind, flags = data[at], data[at + 1]
            order = "<" if flags & _LITTLE else ">"
            size: int = struct.unpack_from(f"{order}H", data, at + 2)[0]
            at += 4
            if size == 0 and kind not in (_PAD, _INFO_TS):
                size = len(data) - at  # the last submessage may leave its length out
            if size > len(data) - at:
                raise RtpsError(f"a submessage of {size} bytes, with {len(data) - at} bytes left")
            body = data[at : at + size]
            at += size
            if kind == _INFO_DST:
                destination = _prefix(body, 0)
            elif kind == _INFO_SRC:
                source, time_ns = _prefix(body, 8), 0
            elif kind == _INFO_TS:
                time_ns = 0 if flags & _NO_TIME else _time_ns(body, order)
            elif (reader := _READERS.get(kind)) is not None:
                found.append(Received(source, destination, time_ns, reader(body, flags, order)))
    except RtpsError as error:
        return Datagram(vendor, found, str(error))
    except struct.error:
        return Datagram(vendor, found, "a submessage that is too short")
    return Datagram(vendor, found, "")


def _prefix(body: bytes, at: int) -> bytes:
    if len(body) < at + PREFIX_BYTES:
        raise RtpsError(f"a prefix in {len(body)} bytes")
    return body[at : at + PREFIX_BYTES]


def _time_ns(body: bytes, order: Order) -> int:
    seconds, fraction = struct.unpack_from(f"{order}II", body)
    return int(seconds * _NS_PER_S + (fraction * _NS_PER_S >> 32))


def read_number64(data: bytes, at: int, order: Order) -> int:
    """A number of 64 bits: its high half comes first in both byte orders. Raises struct.error."""
    high, low = struct.unpack_from(f"{order}iI", data, at)
    return int(high << 32 | low)


def _positive(data: bytes, at: int, order: Order) -> int:
    number = read_number64(data, at, order)
    if not 0 < number <= MAX_NUMBER:
        raise RtpsError(f"a sample with the number {number}")
    return number


def _members(
    data: bytes, at: int, order: Order, base: int, most: int = MAX_NUMBER
) -> tuple[tuple[int, ...], int]:
    """The members of a set whose bit count is at `at`, and the offset of the first byte after it."""
    bits: int = struct.unpack_from(f"{order}I", data, at)[0]
    if bits > MOST_IN_SET:
        raise RtpsError(f"a set of {bits} numbers; at most {MOST_IN_SET} are allowed")
    words = struct.unpack_from(f"{order}{(bits + 31) // 32}I", data, at + 4)
    members = [base + bit for bit in range(bits) if words[bit // 32] >> (31 - bit % 32) & 1]
    if max([base, *members[-1:]]) > most:
        raise RtpsError(f"a set of numbers from {base} on")
    return tuple(members), at + 4 + 4 * len(words)


def _inline(body: bytes, flags: int, order: Order, fixed: int) -> tuple[Parameters, int]:
    """Inline QoS, and the offset of the payload. `fixed`: the end of the fields before."""
    start = 4 + struct.unpack_from(f"{order}H", body, 2)[0]
    if not fixed <= start <= len(body):
        raise RtpsError(f"inline QoS at byte {start} of {len(body)}")
    if not flags & _INLINE:
        return {}, start
    found, end = read_parameters(body, order, start)
    return found, end


def _read_data(body: bytes, flags: int, order: Order) -> Data:
    number = _positive(body, 12, order)
    inline, start = _inline(body, flags, order, 20)
    has_payload = flags & _HAS_DATA and not flags & _IS_KEY
    return Data(body[4:8], body[8:12], number, body[start:] if has_payload else None, inline, order)


def _read_fragments(body: bytes, flags: int, order: Order) -> DataFragments:
    number = _positive(body, 12, order)
    first, count, fragment_bytes, total = struct.unpack_from(f"{order}IHHI", body, 20)
    inline, start = _inline(body, flags, order, 32)
    if not first or not count or not fragment_bytes or flags & _FRAGMENT_IS_KEY:
        raise RtpsError(f"{count} fragments of {fragment_bytes} bytes, from {first} on")
    begin = (first - 1) * fragment_bytes
    size = min(total - begin, count * fragment_bytes)
    if size <= (count - 1) * fragment_bytes or size > len(body) - start:
        raise RtpsError(
            f"{count} fragments of {fragment_bytes} bytes, from {first} on, of {total} bytes, in "
            f"{len(body) - start} bytes"
        )
    payload = body[start : start + size]
    return DataFragments(
        body[4:8], body[8:12], number, first, count, fragment_bytes, total, payload, inline, order
    )


def _read_heartbeat(body: bytes, flags: int, order: Order) -> Heartbeat:
    first, last = read_number64(body, 8, order), read_number64(body, 16, order)
    if first <= 0 or not first - 1 <= last <= MAX_NUMBER:
        raise RtpsError(f"a heartbeat for the numbers {first} to {last}")
    count = struct.unpack_from(f"{order}I", body, 24)[0]
    return Heartbeat(body[:4], body[4:8], first, last, count, bool(flags & _FINAL))


def _read_heartbeat_fragment(body: bytes, flags: int, order: Order) -> HeartbeatFragment:
    last, count = struct.unpack_from(f"{order}II", body, 16)
    return HeartbeatFragment(body[:4], body[4:8], _positive(body, 8, order), last, count)


def _read_acknack(body: bytes, flags: int, order: Order) -> AckNack:
    # Fast DDS and others send base 0 without members as their first word to a writer.
    base = max(read_number64(body, 8, order), 1)
    missing, at = _members(body, 16, order, base)
    count = struct.unpack_from(f"{order}I", body, at)[0]
    return AckNack(body[:4], body[4:8], base, missing, count, bool(flags & _FINAL))


def _read_nack_fragments(body: bytes, flags: int, order: Order) -> NackFragments:
    base = struct.unpack_from(f"{order}I", body, 16)[0]
    missing, at = _members(body, 20, order, base, _MOST_FRAGMENT)
    count = struct.unpack_from(f"{order}I", body, at)[0]
    return NackFragments(body[:4], body[4:8], _positive(body, 8, order), missing, count)


def _read_gap(body: bytes, flags: int, order: Order) -> Gap:
    first, base = _positive(body, 8, order), _positive(body, 16, order)
    more, _ = _members(body, 24, order, base)
    return Gap(body[:4], body[4:8], first, base, more)


_READERS: Final[Mapping[int, Callable[[bytes, int, Order], Submessage]]] = {
    _ACKNACK: _read_acknack,
    _HEARTBEAT: _read_heartbeat,
    _GAP: _read_gap,
    _NACK_FRAG: _read_nack_fragments,
    _HEARTBEAT_FRAG: _read_heartbeat_fragment,
    _DATA: _read_data,
    _DATA_FRAG: _read_fragments,
}


# --- out, always little-endian


def write_head(prefix: bytes, vendor: bytes = OUR_VENDOR) -> bytes:
    """The beginning of a datagram of our participant with that prefix."""
    return _MAGIC + _VERSION + vendor + prefix


def _submessage(kind: int, flags: int, body: bytes) -> bytes:
    return struct.pack("<BBH", kind, flags | _LITTLE, len(body)) + body


def write_destination(prefix: bytes) -> bytes:
    """The following submessages are for the participant with that prefix."""
    return _submessage(_INFO_DST, 0, prefix)


def write_time(time_ns: int) -> bytes:
    """The time of publication of the following samples."""
    seconds, rest = divmod(time_ns, _NS_PER_S)
    fraction = min(-(-(rest << 32) // _NS_PER_S), 0xFFFF_FFFF)  # rounded up: reading rounds down
    return _submessage(_INFO_TS, 0, struct.pack("<II", seconds & 0xFFFF_FFFF, fraction))


def write_number64(number: int) -> bytes:
    return struct.pack("<iI", number >> 32, number & 0xFFFF_FFFF)


def _set(base: int, members: Iterable[int]) -> bytes:
    """Bit count and bits of a set. Members outside `base` to `base` + 255 are an error of the caller."""
    offsets = [member - base for member in members]
    bits = max(offsets, default=-1) + 1
    words = [0] * ((bits + 31) // 32)
    for offset in offsets:
        words[offset // 32] |= 1 << (31 - offset % 32)
    return struct.pack(f"<I{len(words)}I", bits, *words)


def write_data(
    reader: bytes, writer: bytes, number: int, payload: bytes | None, inline: bytes = b""
) -> bytes:
    """A sample. `inline` is a parameter list; `payload` None: only news, in `inline`."""
    flags = (_INLINE if inline else 0) | (0 if payload is None else _HAS_DATA)
    fixed = struct.pack("<HH", 0, 16) + reader + writer + write_number64(number)
    return _submessage(_DATA, flags, fixed + inline + (payload or b""))


def write_fragment(
    reader: bytes,
    writer: bytes,
    number: int,
    fragment: int,
    fragment_bytes: int,
    payload: bytes,
    inline: bytes = b"",
) -> bytes:
    """The fragment with the number `fragment`, from 1, of a whole `payload`."""
    begin = (fragment - 1) * fragment_bytes
    fixed = struct.pack("<HH", 0, 28) + reader + writer + write_number64(number)
    counts = struct.pack("<IHHI", fragment, 1, fragment_bytes, len(payload))
    body = fixed + counts + inline + payload[begin : begin + fragment_bytes]
    return _submessage(_DATA_FRAG, _INLINE if inline else 0, body)


def write_heartbeat(
    reader: bytes, writer: bytes, first: int, last: int, count: int, *, is_final: bool
) -> bytes:
    body = reader + writer + write_number64(first) + write_number64(last) + _count(count)
    return _submessage(_HEARTBEAT, _FINAL if is_final else 0, body)


def write_heartbeat_fragment(
    reader: bytes, writer: bytes, number: int, last_fragment: int, count: int
) -> bytes:
    body = reader + writer + write_number64(number) + struct.pack("<I", last_fragment) + _count(count)
    return _submessage(_HEARTBEAT_FRAG, 0, body)


def write_acknack(
    reader: bytes, writer: bytes, base: int, missing: Sequence[int], count: int, *, is_final: bool
) -> bytes:
    body = reader + writer + write_number64(base) + _set(base, missing) + _count(count)
    return _submessage(_ACKNACK, _FINAL if is_final else 0, body)


def write_nack_fragments(
    reader: bytes, writer: bytes, number: int, missing: Sequence[int], count: int
) -> bytes:
    """`missing` must not be empty, and spans at most 256 fragments."""
    base = missing[0]
    body = reader + writer + write_number64(number) + struct.pack("<I", base)
    return _submessage(_NACK_FRAG, 0, body + _set(base, missing) + _count(count))


def write_gap(reader: bytes, writer: bytes, first: int, base: int, more: Sequence[int] = ()) -> bytes:
    body = (reader or UNKNOWN_ENTITY) + writer + write_number64(first) + write_number64(base)
    return _submessage(_GAP, 0, body + _set(base, more))


def _count(count: int) -> bytes:
    return struct.pack("<I", count & 0x7FFF_FFFF)

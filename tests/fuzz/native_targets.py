"""The native core's handling of packs of samples and of payloads. Needs the core."""

from collections.abc import Callable
from typing import Any

import msgspec

from bus import shm
from bus.shm import segments
from bus.types.classes import message_class as native_class
from bus.wire.source_time import SOURCE_BYTES, source_head, source_ns_of
from bus_bridge.packed import RECORD, scan, scan_here
from bus_ros.rosidl.classes import message_class
from bus_ros.rosidl.support import support_of
from bus_ros.rosidl.wire import codec
from fuzz.script import Script

__all__ = ["check_pack", "packs", "plans"]

_NAMES = (
    *("std_msgs/msg/" + name for name in ("String", "Int8", "UInt16", "UInt64", "Bool", "Float32", "Header")),
    *("geometry_msgs/msg/" + name for name in ("TransformStamped", "Twist")),
    "sensor_msgs/msg/Temperature",
)
_FOR_EVER = 1 << 62

Outcome = tuple[Any, ...]


def check_pack(pack: tuple[Any, ...] | None, most_bytes: int, longest: int) -> int:
    """Check the report of `Reader.take_packed`, or of `take_merged`, about a pack; returns the number of
    samples."""
    if pack is None:
        return 0
    source, data, count, payload_bytes, last_at, is_consecutive, _ = pack
    assert 0 < len(data) <= most_bytes
    found = scan_here(data, 0, _FOR_EVER)
    assert (found.records, found.stop, found.payload_bytes) == (count, len(data), payload_bytes)
    assert (found.last_at, found.is_consecutive and source is not None) == (last_at, is_consecutive)
    assert len(data) - last_at - RECORD.size < longest
    assert isinstance(count, int)
    return count


def packs(data: bytes) -> None:
    """A pack is read as in Python; its published samples come back unchanged when packed again."""
    script = Script(data)
    _, memory = ring = segments.make_ring((4096, 32768)[script.byte() % 2], 16 << script.byte() % 4, 1)
    writer = shm.native.Writer(memory, 1 + script.byte() % 8)
    segment, readers_memory = segments.make_readers(1)
    doorbell = segments.make_doorbell()
    readers = shm.native.Readers(readers_memory, doorbell.number)
    reader: shm.native.Reader[Any] = shm.native.Reader(readers, "owner", 0, tells_cursor=True)
    reader.attach(1, segments.map_ring(ring[0]), 0, start=1)
    writer.add_gate(1, shm.native.Bell(segments.map_readers(segment), doorbell.number), 0, is_lossless=True)
    if script.byte() % 4 == 1:
        writer.most = script.byte()
    most_bytes, longest = script.number(300, signed=False) & 0xFFFF, script.number(100, signed=False)
    whole = _pack(script)
    start = min(script.byte(), len(whole)) if script.byte() & 1 else 0
    limit = script.number(_FOR_EVER, signed=False)
    found = scan(whole, start, limit)
    assert found == scan_here(whole, start, limit)
    expected = [_published(*_sample(whole, at)) for at in _places(whole, start)]
    done = 0
    while True:
        published, _ = writer.publish_packed(whole, start)
        start = scan_here(whole, start, published).stop
        taken: list[tuple[int, bytes]] = []
        take = reader.take_merged if start & 1 else reader.take_packed
        while (pack := take(most_bytes, longest, 0)) is not None:
            check_pack(pack, most_bytes, longest)
            taken += [_sample(pack[1], at) for at in _places(pack[1], 0)]
        for payload, stamp_ns, *_ in reader.take(1000, bytes):
            taken.append((max(-stamp_ns, 0), payload))
        assert len(taken) == published
        assert all(map(_is_same, taken, expected[done : done + published]))
        done += published
        if not published:
            break
    assert writer.samples == reader.samples == done <= len(expected)
    assert reader.overrun == reader.replaced == 0


def _pack(script: Script) -> bytes:
    """Records, some with a wrong size, or arbitrary bytes."""
    parts: list[bytes] = []
    for _ in range(script.byte() % 16):
        kind = script.byte()
        payload = bytes(script.byte() << (5 if kind & 4 else 0))
        if kind & 1:
            payload = source_head(1 + (script.number() & 0xFFFF_FFFF_FFFF)) + payload
        size = script.number(len(payload), signed=False) & 0xFFFF_FFFF if kind % 16 == 2 else len(payload)
        time_ns = min(script.number(), (1 << 63) - 1) if kind & 8 else 0
        parts += (RECORD.pack(script.number(signed=False), time_ns, size), payload)
    return b"".join([*parts, script.take(script.byte() % 40)])


def _places(whole: bytes, start: int) -> list[int]:
    places = []
    while len(whole) - start >= RECORD.size:
        size = RECORD.unpack_from(whole, start)[2]
        if size > len(whole) - start - RECORD.size:
            break
        places.append(start)
        start += RECORD.size + size
    return places


def _sample(whole: bytes, at: int) -> tuple[int, bytes]:
    """The source time and the payload."""
    _, time_ns, size = RECORD.unpack_from(whole, at)
    return time_ns, whole[at + RECORD.size :][:size]


def _published(time_ns: int, payload: bytes) -> tuple[int, bytes]:
    """The sample as a receiver of single samples sees it; without a source time, 0."""
    if time_ns > 0:
        payload = source_head(time_ns) + payload
    time_ns = source_ns_of(payload)
    return time_ns, payload[SOURCE_BYTES:] if time_ns else payload


def _is_same(taken: tuple[int, bytes], given: tuple[int, bytes]) -> bool:
    """Whether the samples agree; a missing time has become the time of publication."""
    return taken[1] == given[1] and (taken[0] == given[0] or given[0] == 0)


def _outcome(decode: Callable[[Any], Any], payload: Any) -> Outcome:
    try:
        message = decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        return type(error), str(error)
    return type(message), repr(message)


def plans(data: bytes) -> None:
    """A plan decodes as msgspec does, or leaves it to msgspec; it encodes decoded messages as msgspec."""
    script = Script(data)
    name = script.choose(_NAMES)
    payload = script.rest()
    cls: Any = message_class(name)
    support: Any = support_of(cls)
    slowly = codec(cls, native_class(name))[1]
    found = _outcome(support.decode, payload)
    assert found == _outcome(slowly, payload) == _outcome(support.decode, memoryview(payload))
    if found[0] is cls:
        message = support.decode(payload)
        assert support.plan.encode(message) in (None, support.encode(message))

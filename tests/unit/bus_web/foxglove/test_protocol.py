"""Foxglove's protocol: requests of clients, and frames of the server."""

import struct
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_web.foxglove import protocol
from bus_web.foxglove.protocol import Level, Misunderstood, Publish, read
from rows import for_each


@for_each(
    ("said", "fields"),
    [
        (
            '{"op":"subscribe","subscriptions":[{"id":0,"channelId":4294967295,"new":1}]}',
            {"subscriptions": [{"id": 0, "channelId": 2**32 - 1}]},
        ),
        ('{"op":"unsubscribe","subscriptionIds":[1,2]}', {"subscriptionIds": [1, 2]}),
        (
            '{"op":"advertise","channels":[{"id":7,"topic":"/a","encoding":"cdr","schemaName":"a/B"}]}',
            {
                "channels": [
                    {
                        "id": 7,
                        "topic": "/a",
                        "encoding": "cdr",
                        "schemaName": "a/B",
                        "schema": None,
                        "schemaEncoding": None,
                    }
                ]
            },
        ),
        ('{"op":"unadvertise","channelIds":[7]}', {"channelIds": [7]}),
        ('{"op":"getParameters","parameterNames":[],"id":"x"}', {"parameterNames": [], "id": "x"}),
        (
            '{"op":"setParameters","parameters":[{"name":"/n.p","value":1.5,"type":"float64"}]}',
            {"parameters": [{"name": "/n.p", "value": 1.5, "type": "float64"}], "id": None},
        ),
        ('{"op":"subscribeConnectionGraph"}', {}),
    ],
)
def test_what_clients_say(said: str, fields: dict[str, Any]) -> None:
    found = msgspec.to_builtins(read(said))
    found.pop("op")
    assert found == fields


def test_binary_frames() -> None:
    publish = read(b"\x01\x02\x00\x00\x00data")
    assert isinstance(publish, Publish)
    assert (publish.channel_id, bytes(publish.data)) == (2, b"data")
    call = read(b"\x02" + struct.pack("<III", 3, 4, 3) + b"cdrbody")
    assert isinstance(call, protocol.Call)
    assert (call.service_id, call.call_id, call.encoding, bytes(call.data)) == (3, 4, "cdr", b"body")
    assert protocol.response(call, "cdr", [b"a", b"b"]) == b"\x03" + struct.pack("<III", 3, 4, 3) + b"cdrab"


def test_playback() -> None:
    """The bytes are those of Foxglove's SDK in its own tests."""
    play, seek = "00 0000803f 00 0000000000000000", "00 0000803f 01 15cd5b0700000000"
    id = "07000000 736f6d652d6964"
    for frame, is_paused, seek_ns in (
        (f"03 {play} {id}", False, None),
        (f"03 01{play[2:]} {id}", True, None),
        (f"03 {seek} {id}", False, 123_456_789),
    ):
        assert read(bytes.fromhex(frame)) == protocol.PlaybackRequest(is_paused, 1.0, seek_ns, "some-id")
    playing = protocol.PlaybackStatus.PLAYING
    head = "05 00 3930000000000000 0000803f"
    assert protocol.playback_state(playing, 12345, 1.0, did_seek=True) == bytes.fromhex(f"{head} 01 00000000")
    told = protocol.playback_state(playing, 12345, 1.0, did_seek=False, id="i-am-a-request")
    assert told == bytes.fromhex(f"{head} 00 0e000000 692d616d2d612d72657175657374")


@for_each(
    ("frame", "text"),
    [
        (b"", "an empty frame"),
        (b"\x09", "no binary frame begins with 9"),
        (b"\x01\x00\x00", "this frame has 3 bytes"),
        (b"\x02" + bytes(11), "this frame has 12"),
        (b"\x02" + struct.pack("<III", 1, 1, 2**32 - 1), "4294967295 bytes; 0 are there"),
        (b"\x03" + bytes(17), "19 bytes at least; this frame has 18"),
        (b"\x03\x02" + bytes(17), "no command of playback: 2"),
        (b"\x03" + bytes(14) + struct.pack("<I", 5) + b"four", "should have 5 bytes; 4 are possible"),
        (b"\x03" + bytes(14) + struct.pack("<I", 1001) + bytes(1001), "1001 bytes; 1000 are possible"),
        ("{", "not understood"),
        ("[]", "not understood"),
        ('{"op":"dance"}', "Invalid value 'dance'"),
        ('{"op":"subscribe"}', "subscriptions"),
        ('{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}', ">= 0"),
        ('{"op":"subscribe","subscriptions":[{"id":1,"channelId":4294967296}]}', "<= 4294967295"),
        ('{"op":"unsubscribe","subscriptionIds":[1e400]}', "not understood"),
        ("[" * 100_000, "not understood"),
        ("[" + " " * (1 << 20) + "]", "a text has 1048576 characters at most; this one has 1048578"),
        (f'{{"op":"getParameters","id":"{"x" * 1001}"}}', "length <= 1000"),
        (f'{{"op":"subscribeParameterUpdates","parameterNames":["{"x" * 1001}"]}}', "length <= 1000"),
        (f'{{"op":"getParameters","parameterNames":[{"0," * 10_000}0]}}', "not understood"),
        (
            f'{{"op":"getParameters","parameterNames":{msgspec.json.encode(["x"] * 10_001).decode()}}}',
            "<= 10000",
        ),
    ],
)
def test_what_makes_no_sense(frame: str | bytes, text: str) -> None:
    with pytest.raises(Misunderstood) as caught:
        read(frame)
    assert text in str(caught.value)


@given(st.one_of(st.binary(), st.text(), st.binary().map(lambda data: bytes([2 + len(data) % 2]) + data)))
def test_nothing_hostile_raises_anything_else(frame: str | bytes) -> None:
    try:
        read(frame)
    except Misunderstood:
        pass


def test_frames_of_the_server() -> None:
    assert protocol.message(5, 6, [b"ab", memoryview(b"cd")]) == b"\x01" + struct.pack("<IQ", 5, 6) + b"abcd"
    assert protocol.time(7) == b"\x02" + struct.pack("<Q", 7)
    said = protocol.status(Level.ERROR, "x" * 10_000, "id")
    assert msgspec.json.decode(said) == {"op": "status", "level": 2, "message": "x" * 497 + "...", "id": "id"}
    told = msgspec.json.decode(protocol.parameter_values([protocol.Parameter("/n.p", 1)], "q"))
    assert told == {"op": "parameterValues", "parameters": [{"name": "/n.p", "value": 1}], "id": "q"}
    assert protocol.asset(9, b"mesh") == b"\x04" + struct.pack("<IBI", 9, 0, 0) + b"mesh"
    assert protocol.asset_missing(9, "no") == b"\x04" + struct.pack("<IBI", 9, 1, 2) + b"no"

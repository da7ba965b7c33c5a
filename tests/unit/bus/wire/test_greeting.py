"""bus.wire.greeting: a Hello from bytes, and not one byte more."""

import pytest

from bus.errors import RemoteProtocolError
from bus.wire import messages as m
from bus.wire.greeting import MAX_HELLO_BYTES, Greeting
from bus.wire.layout import CONTROL, DATA, FRAME_HEAD, PROTOCOL_VERSION
from raw_peer import control
from rows import for_each

LONGEST = m.Hello(
    version=PROTOCOL_VERSION,
    capabilities=("\U0001f600" * 64,) * 64,
    program="\U0001f600" * 1000,
    release="\U0001f600" * 1000,
)


def read(stream: bytes, at_once: int = 1 << 20) -> tuple[m.Hello | None, int]:
    """The Hello that a greeting reads from a stream in pieces, and the number of bytes that it read."""
    greeting, at = Greeting(), 0
    while at < len(stream):
        piece = stream[at : at + min(at_once, greeting.wanted)]
        at += len(piece)
        if (hello := greeting.received(piece)) is not None:
            return hello, at
    return None, at


@for_each("at_once", [1, 3, 1 << 20])
def test_nothing_behind_it_is_read(at_once: int) -> None:
    for hello in (m.Hello(version=PROTOCOL_VERSION), LONGEST):
        frame = m.encode_frame(hello)
        assert read(frame + b"the next frame", at_once) == (hello, len(frame))


def test_a_part_of_it_is_none() -> None:
    frame = m.encode_frame(LONGEST)
    assert len(frame) < MAX_HELLO_BYTES
    for stop in (0, 5, 8, len(frame) - 1):
        assert read(frame[:stop]) == (None, stop)


@for_each(
    ("stream", "reason"),
    [
        (m.encode_frame(m.Ping()), "a Ping came before Hello"),
        (FRAME_HEAD.pack(28, DATA, 0, 0), "a data frame came before Hello"),
        (b"GET / HTTP/1.1", "frame of unknown kind 47"),
        (FRAME_HEAD.pack(9, CONTROL, 2, 0), "frame with unknown flags 0x2"),
        (FRAME_HEAD.pack(9, CONTROL, 0, 1), "frame with unknown flags 0x0"),
        (FRAME_HEAD.pack(0, CONTROL, 0, 0), "frame of 0 bytes; that of a Hello has 5 to 32772"),
        (FRAME_HEAD.pack(4, CONTROL, 0, 0), "frame of 4 bytes; that of a Hello has 5 to 32772"),
        (FRAME_HEAD.pack(5 + MAX_HELLO_BYTES, CONTROL, 0, 0), "frame of 32773 bytes"),
        (control(b"\xc1"), "control message not understood"),
        (
            m.encode_frame(m.Hello(version=PROTOCOL_VERSION + 1)),
            f"version {PROTOCOL_VERSION + 1} offered, this side speaks {PROTOCOL_VERSION}",
        ),
    ],
)
def test_what_is_no_hello(stream: bytes, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        read(stream)

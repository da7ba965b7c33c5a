"""bus.wire.session: the table of states for both roles, and violations of the protocol by a peer."""

from typing import Any

import msgspec
import pytest

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    MAX_CONTROL_BYTES,
    PROTOCOL_VERSION,
    RUN_BYTES,
)
from bus.wire.runs import Run
from bus.wire.session import MAX_BATCHES, Carried, Role, Session, State
from feeding import feed, frame_record
from rows import for_each

HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION, pid=7, program="talker"))
PING = m.encode_frame(m.Ping(number=1))


def control(body: bytes) -> bytes:
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


def data(body: bytes, count: int = 1) -> bytes:
    length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
    return DATA_HEAD.pack(length, DATA, 0, 0, 1, 0, 1, count, 0) + body


RUN = data(frame_record(b"payload", 5))


def session(role: Role, state: State) -> Session:
    made = Session(role)
    if state is not State.NEW:
        list(feed(made, HELLO))
    if state is State.CLOSED:
        with pytest.raises(RemoteProtocolError):
            list(feed(made, HELLO))
    assert made.state is state
    return made


def refusal(made: Session, frames: bytes) -> str:
    with pytest.raises(RemoteProtocolError) as caught:
        list(feed(made, frames))
    assert made.state is State.CLOSED
    return str(caught.value)


@pytest.mark.parametrize("role", Role)
class TestStates:
    def test_hello_opens(self, role: Role) -> None:
        made = session(role, State.NEW)
        assert list(feed(made, HELLO)) == [m.Hello(version=PROTOCOL_VERSION, pid=7, program="talker")]
        assert made.state is State.OPEN
        assert made.peer == m.Hello(version=PROTOCOL_VERSION, pid=7, program="talker")

    def test_what_comes_when_open(self, role: Role) -> None:
        ping, run = feed(session(role, State.OPEN), PING + RUN)
        assert ping == m.Ping(number=1)
        assert isinstance(run, Run)

    @pytest.mark.parametrize(
        ("state", "frame", "text"),
        [
            (State.NEW, PING, "a Ping came before Hello"),
            (State.NEW, RUN, "a data frame came before Hello"),
            (State.OPEN, HELLO, "a Hello came a second time"),
            (State.CLOSED, HELLO, "a Hello came after an error"),
            (State.CLOSED, PING, "a Ping came after an error"),
            (State.CLOSED, RUN, "a data frame came after an error"),
        ],
        ids=lambda value: "" if isinstance(value, bytes) else str(value),
    )
    def test_what_is_refused(self, role: Role, state: State, frame: bytes, text: str) -> None:
        assert refusal(session(role, state), frame) == text

    @pytest.mark.parametrize("version", [PROTOCOL_VERSION - 1, PROTOCOL_VERSION + 1, -1, 2**63])
    def test_another_version(self, role: Role, version: int) -> None:
        made = Session(role)
        text = refusal(made, m.encode_frame(m.Hello(version=version)))
        assert text.startswith(f"protocol version {version} offered, this side speaks {PROTOCOL_VERSION};")
        assert made.peer is None

    def test_a_later_hello_may_say_more(self, role: Role) -> None:
        body = msgspec.msgpack.encode({"m": "hello", "version": PROTOCOL_VERSION, "colour": "blue"})
        (hello,) = feed(Session(role), control(body))
        assert hello == m.Hello(version=PROTOCOL_VERSION)

    def test_a_broken_frame_closes(self, role: Role) -> None:
        assert refusal(session(role, State.OPEN), b"\xff" * 8) == "frame of unknown kind 255"

    @pytest.mark.parametrize("mistake", [HELLO, b"\xff" * 40], ids=["a second Hello", "garbage"])
    @pytest.mark.parametrize("first", [PING, RUN], ids=["after a message", "after a run"])
    def test_what_came_before_the_mistake_is_given_out(
        self, role: Role, first: bytes, mistake: bytes
    ) -> None:
        made = session(role, State.OPEN)
        items = feed(made, first + mistake)
        assert next(items) is not None
        with pytest.raises(RemoteProtocolError):
            next(items)
        assert made.state is State.CLOSED


class TestRoles:
    def test_a_broker_takes_no_answers(self) -> None:
        text = refusal(session(Role.BROKER, State.OPEN), m.encode_frame(m.Created(request=1, id=1)))
        assert text.startswith("control message not understood: ")
        assert "created" in text

    def test_a_client_takes_no_requests(self) -> None:
        text = refusal(session(Role.CLIENT, State.OPEN), m.encode_frame(m.CreateNode(request=1, name="a")))
        assert "node+" in text

    def test_only_a_client_takes_long_control_messages(self) -> None:
        frame = m.encode_frame(m.Fault(text="x" * MAX_CONTROL_BYTES))
        assert len(list(feed(session(Role.CLIENT, State.OPEN), frame))) == 1
        assert "frame of" in refusal(session(Role.BROKER, State.OPEN), frame)


class Token(Descriptor):
    """A placeholder for a descriptor."""

    def __init__(self) -> None:
        super().__init__(-1)
        self.is_closed = False

    def close(self) -> None:
        self.is_closed = True


def batch(count: int) -> tuple[Token, ...]:
    return tuple(Token() for _ in range(count))


SHARE = m.encode_frame(m.Share())
RING = m.encode_frame(m.ReplaceRing(publisher=1))


class TestDescriptors:
    def test_a_message_takes_its_own(self) -> None:
        made, pair, ring = session(Role.BROKER, State.OPEN), batch(2), batch(1)
        made.descriptors += pair, ring
        found = list(feed(made, PING + SHARE + PING + RING))
        assert found == [
            m.Ping(number=1),
            Carried(m.Share(), pair),
            m.Ping(number=1),
            Carried(m.ReplaceRing(publisher=1), ring),
        ]
        assert not made.descriptors
        assert not any(token.is_closed for token in (*pair, *ring))

    def test_a_batch_waits_for_the_end_of_its_message(self) -> None:
        made, pair = session(Role.BROKER, State.OPEN), batch(2)
        assert list(feed(made, SHARE[:1])) == []
        made.descriptors.append(pair)
        assert list(feed(made, SHARE[1:-1], [1] * len(SHARE))) == []
        assert list(feed(made, SHARE[-1:])) == [Carried(m.Share(), pair)]

    def test_a_message_that_claims_none_takes_none(self) -> None:
        made, ring = session(Role.BROKER, State.OPEN), batch(1)
        made.descriptors.append(ring)
        none = m.ReplaceRing(publisher=1, descriptors=0)
        assert list(feed(made, m.encode_frame(none) + RING)) == [
            none,
            Carried(m.ReplaceRing(publisher=1), ring),
        ]

    @pytest.mark.parametrize("count", [0, 1])
    def test_a_batch_of_another_number_is_closed(self, count: int) -> None:
        """The session uses no incomplete batch. 0 means that the batch was cut off on the way."""
        made, part, ring = session(Role.BROKER, State.OPEN), batch(count), batch(1)
        made.descriptors += part, ring
        assert list(feed(made, SHARE + RING)) == [
            Carried(m.Share(), ()),
            Carried(m.ReplaceRing(publisher=1), ring),
        ]
        assert all(token.is_closed for token in part)
        assert not ring[0].is_closed

    def test_where_none_can_come(self) -> None:
        assert list(feed(session(Role.BROKER, State.OPEN), SHARE)) == [Carried(m.Share(), ())]

    @for_each("frame", [PING, RUN, RUN[:1]])
    def test_a_flood_that_no_message_claims(self, frame: bytes) -> None:
        made = session(Role.BROKER, State.OPEN)
        sent = [batch(2) for _ in range(MAX_BATCHES + 1)]
        frames = RUN if len(frame) == 1 else frame * len(sent)
        size = len(frames) // len(sent)
        with pytest.raises(RemoteProtocolError, match="descriptors that no message claims"):
            for at, tokens in enumerate(sent):
                assert at == len(made.descriptors) < len(sent)
                made.descriptors.append(tokens)
                list(feed(made, frames[at * size : (at + 1) * size]))
        assert len(made.descriptors) == len(sent)
        assert made.state is State.CLOSED
        made.drop_descriptors()
        assert not made.descriptors
        assert all(token.is_closed for tokens in sent for token in tokens)


class TestLimitOfAMessage:
    """A publisher knows the size of the largest message. A run with such a message must be accepted."""

    LIMIT = 100_000

    def take(self, *sizes: int) -> list[Any]:
        made = Session(Role.BROKER, max_message_bytes=self.LIMIT)
        list(feed(made, HELLO))
        return list(feed(made, data(b"".join(frame_record(bytes(size), 5) for size in sizes), len(sizes))))

    def test_the_largest_message(self) -> None:
        assert len(self.take(self.LIMIT)) == 1

    def test_after_others_in_one_run(self) -> None:
        """A publisher ends a run only after it has reached RUN_BYTES."""
        assert len(self.take(RUN_BYTES - 13, self.LIMIT)) == 1

    def test_too_large(self) -> None:
        with pytest.raises(RemoteProtocolError, match="frame of"):
            self.take(self.LIMIT + RUN_BYTES + 1)


def nested(depth: int, tip: bytes = b"\xc0") -> bytes:
    return b"\x91" * depth + tip


BOMBS = {
    "depth in place of a message": nested(500_000),
    "depth without an end": nested(500_000, b""),
    "depth in a field": b"\x82\xa1m\xa5hello\xa7version" + nested(500_000),
    "depth in a field nobody knows": b"\x82\xa1m\xa4ping\xa1x" + nested(500_000),
    "depth in a raw schema": b"\x84\xa1m\xa4type\xa9type_name\xa1a\xa9type_hash\xa1a\xa6schema"
    + nested(500_000),
    "a map that claims 4 G entries": b"\xdf\xff\xff\xff\xff",
    "an array that claims 4 G entries": b"\x82\xa1m\xa5hello\xaccapabilities\xdd\xff\xff\xff\xff",
    "a string that claims 4 GB": b"\x81\xa1m\xdb\xff\xff\xff\xff",
    "text that is not UTF-8": b"\x82\xa1m\xa5hello\xa7program\xa2\xff\xff",
    "no tag": msgspec.msgpack.encode({"version": 1}),
    "an unknown tag": msgspec.msgpack.encode({"m": "zzz"}),
    "a tag that is a number": msgspec.msgpack.encode({"m": 1}),
    "a missing field": msgspec.msgpack.encode({"m": "node+", "request": 1}),
    "a wrong type": msgspec.msgpack.encode({"m": "ping", "number": "one"}),
    "a number beyond 64 bits": b"\x82\xa1m\xa4ping\xa6number\xca\x7f\x80\x00\x00",
    "bytes after the message": msgspec.msgpack.encode({"m": "ping"}) + b"\xc0",
    "an array": msgspec.msgpack.encode(["ping"]),
    "nothing": b"",
}


@for_each("body", BOMBS.values())
def test_control_messages_that_are_none(body: bytes) -> None:
    """Each one is refused with a text, and none crashes the interpreter."""
    assert refusal(session(Role.BROKER, State.OPEN), control(body)).startswith(
        "control message not understood: "
    )

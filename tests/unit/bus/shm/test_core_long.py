"""Long fields past the encoder and the decoder: one copy into the ring, and one out of it."""

from functools import partial
from typing import Any

import msgspec
import pytest

from bus.types.support import TypeSupport, type_support
from rows import for_each
from shm_ends import Listener, Talker, core

KIB, MIB = 1 << 10, 1 << 20
LONG, LONG_TEXT, BLOCK = 64 * KIB, 16 * KIB, 8 * KIB


class Note(msgspec.Struct, array_like=True):
    text: str = ""
    number: int = 0


class Named(msgspec.Struct, frozen=True):
    text: str = ""
    number: int = 0


class Frame(msgspec.Struct):
    number: int = 0
    data: bytes = b""


ANY_FRAME: Any = Frame


class Late(msgspec.Struct):
    number: int = 0
    text: str = ""


class Own(msgspec.Struct):
    text: str = ""

    def __post_init__(self) -> None:
        if not self.text:
            raise ValueError("no text")


def prepared(cls: Any, *, most_long: int = 1 << 60, capacity: int = 8 * MIB) -> Talker:
    talker = Talker(capacity)
    talker.writer.prepare(*type_support(cls).steps)
    talker.writer.most_long = most_long
    return talker


class Reading:
    """A listener of one talker, with the payloads that its decoder was given."""

    def __init__(self, cls: Any) -> None:
        self.talker, self.listener = prepared(cls), Listener()
        self.support: TypeSupport[Any] = type_support(cls)
        self.listener.join(self.talker, start=1)
        self.listener.reader.expect_texts(partial(getattr, self.support, "text_plan"))
        self.sizes: list[int] = []

    def decode(self, payload: Any) -> Any:
        self.sizes.append(len(payload))
        return self.support.decode(payload)

    def take(self, payload: bytes) -> list[Any]:
        self.talker.write(payload) if len(payload) <= LONG else self.talker.writer.write_parts((payload,))
        return self.listener.reader.messages(10, self.decode)

    def close(self) -> None:
        self.talker.close()
        self.listener.close()


# --- out of a publisher


@for_each(
    "message",
    [
        Note("a" * LONG, 3),
        Note("é" * LONG, 3),
        Named("b" * (LONG + 1), 3),
        Late(3, "c" * MIB),
        Frame(3, b"d" * LONG),
        Frame(3, bytes(MIB - 100)),
    ],
)
def test_a_long_field_goes_into_the_ring_with_the_message_around_it(message: Any) -> None:
    talker, support = prepared(type(message)), type_support(type(message))
    talker.writer.plans_only = True
    assert talker.writer.publish(message) is True
    ((_, _, payload),) = talker.writer.since(0)
    assert support.decode(payload) == message
    assert talker.writer.bytes == len(payload)
    talker.close()


def test_a_field_above_the_limit_is_left_to_the_slow_way() -> None:
    talker = prepared(Frame, most_long=LONG)
    assert talker.writer.publish(Frame(1, bytes(LONG + 1))) is False
    assert talker.writer.publish(Frame(1, bytes(LONG))) is True
    talker.close()


@for_each(
    "message",
    [ANY_FRAME(1, memoryview(bytes(LONG))), ANY_FRAME(1, bytearray(10)), Frame(1 << 70, bytes(LONG))],
)
def test_with_plans_only_nothing_else_is_encoded(message: Frame) -> None:
    talker = prepared(Frame)
    talker.writer.plans_only = True
    assert talker.writer.publish(message) is False
    assert talker.writer.latest == 0
    talker.close()


def test_a_long_message_is_refused_like_a_short_one() -> None:
    talker = prepared(Frame, capacity=MIB)
    assert talker.writer.publish(Frame(1, bytes(MIB // 4))) == core.TOO_LARGE
    talker.writer.most = LONG
    assert talker.writer.publish(Frame(1, bytes(LONG))) == core.TOO_LARGE
    talker.writer.most = 1 << 62
    talker.writer.hold = 1
    while (status := talker.writer.publish(Frame(1, bytes(LONG)))) is True:
        pass
    assert status == core.FULL
    talker.close()


def test_a_long_message_is_not_published_while_a_loan_is_open() -> None:
    talker = prepared(Frame)
    place = talker.lend_field(Frame(1), 1, 3)
    assert talker.writer.publish(Frame(2, bytes(LONG))) is False
    place[:] = b"abc"
    assert talker.writer.publish_lent() is True
    talker.close()


# --- into a subscription


@for_each("cls", [Note, Named])
@for_each("size", [LONG_TEXT, LONG_TEXT + 1, LONG - 1, LONG, MIB - 100])
def test_a_long_text_does_not_pass_the_decoder(cls: Any, size: int) -> None:
    reading = Reading(cls)
    message = cls("".join(chr(32 + number % 95) for number in range(size)), 7)
    (taken,) = reading.take(reading.support.encode(message))
    assert taken == message
    assert taken.text.isascii()
    assert hash(taken.text) == hash(message.text)
    assert reading.sizes[0] < 32
    reading.close()


@for_each("at", [0, 1, BLOCK - 1, BLOCK, 2 * BLOCK + 63, LONG // 2 + 64, LONG - 17, LONG + 15])
def test_a_text_with_another_character_is_decoded_as_usual(at: int) -> None:
    reading = Reading(Note)
    text = "x" * at + "é" + "x" * (LONG + 15 - at)
    payload = reading.support.encode(Note(text, 7))
    assert reading.take(payload) == [Note(text, 7)]
    assert reading.sizes == [len(payload)]
    reading.close()


@for_each("is_found", [False, True])
def test_another_decoder_gets_all_of_a_long_text(is_found: bool) -> None:
    """A drain takes the bytes themselves. `is_found`: the plan of the texts is known already."""
    reading = Reading(Note)
    payload = reading.support.encode(Note("x" * LONG, 7))
    if is_found:
        assert reading.take(payload) == [Note("x" * LONG, 7)]
    for _ in range(2):
        reading.talker.writer.write_parts((payload,))
    taken = reading.listener.reader.take(9, bytes)
    assert [one if isinstance(one, bytes) else one[0] for one in taken] == [payload] * 2
    assert reading.listener.reader.undecodable == 0
    reading.close()


@for_each("at", [0, BLOCK - 1, LONG // 2, LONG - 1])
def test_bytes_that_are_no_text_are_refused(at: int) -> None:
    reading = Reading(Note)
    payload = reading.support.encode(Note("x" * LONG, 7)).replace(
        b"x" * LONG, b"x" * at + b"\xff" + b"x" * (LONG - 1 - at)
    )
    assert reading.take(payload) == []
    assert reading.listener.reader.undecodable == 1
    reading.close()


@for_each(
    ("cls", "payload"),
    [
        (Note, msgspec.msgpack.encode(["x" * LONG])),  # without its last field
        (Note, msgspec.msgpack.encode(["x" * LONG, 7, 8])),
        (Note, b"\xdc\0\x02" + msgspec.msgpack.encode(["x" * LONG, 7])[1:]),
        (Named, msgspec.msgpack.encode({"number": 7, "text": "x" * LONG})),
        (Named, msgspec.msgpack.encode({"text": "x" * LONG, "more": "x" * LONG})),
        (Late, msgspec.msgpack.encode({"number": 7, "text": "x" * LONG})),
        (Own, msgspec.msgpack.encode({"text": "x" * LONG})),
    ],
)
def test_any_other_form_gives_the_decoders_message(cls: Any, payload: bytes) -> None:
    reading = Reading(cls)
    assert reading.take(payload) == [reading.support.decode(payload)]
    reading.close()


@for_each(
    "payload",
    [
        msgspec.msgpack.encode(["x" * LONG, "seven"]),
        msgspec.msgpack.encode(["x" * LONG, 7])[:-1],
        msgspec.msgpack.encode(["x" * LONG, 7])[:-2],
        msgspec.msgpack.encode(["x" * LONG, 7]) + b"\0",
        msgspec.msgpack.encode([b"x" * LONG, 7]),
    ],
)
def test_a_payload_of_another_form_is_refused_as_by_the_decoder(payload: bytes) -> None:
    reading = Reading(Note)
    with pytest.raises(msgspec.DecodeError) as error:
        reading.support.decode(payload)
    assert reading.take(payload) == []
    ((_, found),) = reading.listener.reader.pop_rejected()
    assert type(found) is error.type
    reading.close()


def test_the_plan_is_asked_for_once_and_only_for_long_payloads() -> None:
    reading = Reading(Note)
    asked: list[int] = []

    def find() -> None:
        asked.append(1)

    reading.listener.reader.expect_texts(find)
    reading.take(reading.support.encode(Note("x" * 5_000)))
    assert not asked
    for _ in range(2):
        reading.take(reading.support.encode(Note("x" * LONG)))
    assert asked == [1]
    assert len(reading.sizes) == 3
    reading.close()


def test_an_error_of_the_search_for_the_plan_is_the_samples() -> None:
    reading = Reading(Note)

    def fail() -> None:
        raise LookupError

    reading.listener.reader.expect_texts(fail)
    payload = reading.support.encode(Note("x" * LONG))
    assert reading.take(payload) == []
    assert reading.take(payload) == [Note("x" * LONG)]
    assert reading.listener.reader.undecodable == 1
    reading.close()

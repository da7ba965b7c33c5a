"""Messages of any type: made from the declared schema, and checked against it."""

import msgspec

from bus.msg.geometry_msgs import Twist
from bus.msg.std_msgs import Bool, Int32, String
from bus.schema import MessageSchema
from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import service_support
from bus_cli.doctor.conformance.payloads import NOTHING, fault, make


class Needs(msgspec.Struct):
    number: int


class NeedsMore(msgspec.Struct):
    text: str
    number: int


def without_schema(message_type: type[msgspec.Struct]) -> MessageSchema:
    return msgspec.structs.replace(MessageSchema.of(message_type), encoded=NOTHING)


def test_messages_differ_by_their_number() -> None:
    assert make(MessageSchema.of(String), 3) == b"\x91\xa9message 3"
    assert make(MessageSchema.of(Int32), 3) == b"\x91\x03"


def test_a_type_without_such_a_field_has_one_message() -> None:
    assert make(MessageSchema.of(Bool), 1) == make(MessageSchema.of(Bool), 2) == b"\x91\xc2"
    assert make(MessageSchema.of(Twist), 1) is not None


def test_a_text_of_a_length() -> None:
    body = make(MessageSchema.of(String), 3, 200)
    assert body is not None and msgspec.msgpack.decode(body) == ["message 3".ljust(200, ".")]
    assert make(MessageSchema.of(Int32), 3, 200) is None


def test_a_type_without_a_schema_is_known_by_its_hash() -> None:
    assert make(without_schema(Int32), 3) == b"\x91\x03"
    other = msgspec.structs.replace(without_schema(Int32), type_hash="RIHS01_00")
    assert (make(other, 3), fault(other, b"\xff")) == (None, None)


def test_a_type_without_defaults_has_no_message() -> None:
    assert make(MessageSchema.of(Needs), 5) == msgspec.msgpack.encode({"number": 5})
    assert make(MessageSchema.of(NeedsMore), 5) is None


def test_the_fault_of_a_payload() -> None:
    schema = MessageSchema.of(Int32)
    assert fault(schema, b"\x91\x03") is None
    assert fault(schema, bytes.fromhex("c70d540000000000") + bytes(8) + b"\x91\x03") is None, "a source time"
    assert fault(schema, b"\x91\xa1x") == "Expected `int`, got `str` - at `$[0]`"
    assert fault(schema, b"") is not None


def test_requests_of_services() -> None:
    support = service_support(AddTwoInts)
    schema = MessageSchema(support.requests.name, support.requests.hash, support.requests.description)
    assert MessageSchema.of(schema.description).type_hash == schema.type_hash
    request = support.encode_request(bytes(16), 1, AddTwoInts.Request(a=1, b=2))
    assert fault(schema, request) is None
    assert fault(schema, b"\x90") is not None

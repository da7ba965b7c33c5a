"""Messages of a service between the bus and ROS 2: what one side writes, the other reads."""

from typing import Any

import msgspec
import pytest

from bus.msg.std_msgs import String
from bus.schema import MessageSchema
from bus.srv.example_interfaces import AddTwoInts
from bus.srv.std_srvs import SetBool
from bus.types.classes import service_class
from bus.types.service import service_support
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.service_types import ServiceTypes
from rows import for_each

GID = bytes(range(16))
ADD = "example_interfaces/srv/AddTwoInts"
SUPPORT = service_support(AddTwoInts)
LIST: Any = service_class("rcl_interfaces/srv/ListParameters")


def add() -> ServiceTypes:
    return ServiceTypes.find(ADD)


def test_a_request_of_the_bus() -> None:
    payload = SUPPORT.encode_request(GID, 7, AddTwoInts.Request(a=1, b=-2))
    call = add().read_request(payload)
    assert (call.client, call.number) == (GID, 7)
    assert call.cdr == b"\0\1\0\0" + (1).to_bytes(8, "little") + b"\xfe" + 7 * b"\xff"
    again = add().write_request(GID, 7, call.cdr)
    request = SUPPORT.requests.decode(again)
    assert (request.client, request.number, request.body) == (GID, 7, AddTwoInts.Request(a=1, b=-2))
    assert add().read_request(SUPPORT.encode_question(GID, 8)) == (GID, 8, None)


def test_an_answer_of_the_bus() -> None:
    payload = SUPPORT.encode_response(GID, 7, AddTwoInts.Response(sum=3))
    answer = add().read_reply(payload)
    assert (answer.client, answer.number, answer.error) == (GID, 7, "")
    assert answer.cdr == b"\0\1\0\0\3" + bytes(7)
    reply = SUPPORT.replies(GID).decode(add().write_reply(GID, 7, answer.cdr))
    assert (reply.client, reply.number, reply.error, reply.body) == (GID, 7, "", AddTwoInts.Response(sum=3))
    assert add().read_reply(SUPPORT.encode_denial(GID, 8)) == (GID, 8, "", None)
    assert add().read_reply(SUPPORT.encode_error(GID, 9, "no")) == (GID, 9, "no", None)


def test_answers_without_a_message() -> None:
    decode = SUPPORT.replies(GID).decode
    assert msgspec.structs.astuple(decode(add().write_denial(GID, 7))) == (GID, 7, "", None)
    assert msgspec.structs.astuple(decode(add().write_error(GID, 7, "gone"))) == (GID, 7, "gone", None)
    assert decode(add().write_error(GID, 7, "")).error == "no reason is given"
    assert len(decode(add().write_error(GID, 7, "x" * 9999)).error) == 2000


def test_texts_are_padded() -> None:
    types = ServiceTypes.find("rcl_interfaces/srv/ListParameters")
    support = service_support(LIST)
    call = types.read_request(support.encode_request(GID, 1, LIST.Request(prefixes=["ü"], depth=1)))
    assert call.cdr is not None and len(call.cdr) % 4 == 0
    assert support.requests.decode(types.write_request(GID, 1, call.cdr)).body.prefixes == ["ü"]


def test_types_from_the_bus_are_those_of_the_definition() -> None:
    found = add()
    schemas = found.requests, found.replies
    assert [one.type_name for one in schemas] == [f"{ADD}_Request", f"{ADD}_Response"]
    assert [one.type_hash for one in schemas] == [SUPPORT.requests.hash, SUPPORT.replies(b"").hash]
    own = ServiceTypes.of(*schemas)
    assert own.type_name == ADD
    payload = SUPPORT.encode_request(GID, 7, AddTwoInts.Request(a=1, b=-2))
    assert own.read_request(payload) == found.read_request(payload)


@for_each("payload", [b"", b"\x93", b"\x93\xc4\x01a\1\xc0", msgspec.msgpack.encode([GID, -1, None]), b"\xc0"])
def test_wrong_payloads(payload: bytes) -> None:
    with pytest.raises(BridgeError, match=f"no request of {ADD}"):
        add().read_request(payload)
    with pytest.raises(BridgeError, match=f"no answer of {ADD}"):
        add().read_reply(payload)


def test_wrong_messages() -> None:
    wrong = msgspec.msgpack.encode([GID, 1, ["text", 2]])
    with pytest.raises(BridgeError, match="no payload of"):
        add().read_request(wrong)
    for write in (add().write_request, add().write_reply):
        with pytest.raises(BridgeError, match="no CDR message of"):
            write(GID, 1, b"\0\1\0\0\1")


def test_types_that_are_none_of_a_service() -> None:
    with pytest.raises(BridgeError, match="no_pkg/srv/Nothing"):
        ServiceTypes.find("no_pkg/srv/Nothing")
    text = MessageSchema.of(String)
    with pytest.raises(BridgeError, match="are not of one service"):
        ServiceTypes.of(text, text)
    other = ServiceTypes.find(SetBool.__type_name__)
    with pytest.raises(BridgeError, match="are not of one service"):
        ServiceTypes.of(add().requests, other.replies)


@for_each(
    ("name",),
    [("std_msgs/msg/String",), ("std_srvs/srv/Trigger_Request",), ("example_interfaces/action/Fibonacci",)],
)
def test_the_name_of_another_kind_fails_without_a_search_for_similar_names(name: str) -> None:
    """A far side may give a thousand services such types, and each search takes 20 ms."""
    with pytest.raises(BridgeError) as caught:
        ServiceTypes.find(name)
    assert str(caught.value) == f"{name}: unknown interface '{name}'"

"""The encoding of messages in a bag, by type."""

from typing import Any

import msgspec
import pytest

from bus.errors import ConfigurationError
from bus.msg.sensor_msgs import Imu
from bus.schema import MessageSchema
from bus.types.support import type_support
from bus_bag.record.encoder import encoder_of
from bus_ros.cdr import CdrError, codec_of


def schema(*types: Any) -> MessageSchema:
    fields = [{"name": f"f{number}", "type": one} for number, one in enumerate(types)]
    return MessageSchema.of(
        {"root": "demo/msg/Own", "types": {"demo/msg/Own": {"array": True, "fields": fields}}}
    )


def test_cdr() -> None:
    imu = MessageSchema.of(Imu)
    encoder, why = encoder_of(imu)
    assert (encoder.type_name, encoder.as_json, why) == ("sensor_msgs/msg/Imu", (), "")
    payload = type_support(Imu).encode(Imu())
    assert encoder.encode(payload) == codec_of(imu).encode(payload)


def test_what_can_not_be_cdr_is_a_text_of_json() -> None:
    encoder, why = encoder_of(schema("int32", ["wstring"]))
    assert "wstring" in why
    assert (encoder.type_name, encoder.definition, encoder.as_json) == (
        "busd/msg/Json",
        "string data\n",
        ("demo/msg/Own",),
    )
    data = b"".join(encoder.encode(msgspec.msgpack.encode([7, "wide"])))
    assert data[8:-1] == b'[7,"wide"]'
    with pytest.raises(CdrError, match="a payload that JSON can't represent"):
        encoder.encode(b"\xc1")


def test_what_is_no_schema_is_refused() -> None:
    with pytest.raises(ConfigurationError):
        encoder_of(MessageSchema("demo/msg/Own", "x", msgspec.msgpack.encode({"root": "demo/msg/Own"})))

"""CDR and definitions in bag files: each has one error for all faults."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

import msgspec

import bus
from bus.errors import ConfigurationError
from bus.types.classes import message_class
from bus_ros.cdr import CdrError, Codec, codec_of, schema_of_definition
from fuzz.script import Script
from ownclasses import Wheel

_READY_MADE: Final = (
    *("std_msgs/msg/String", "std_msgs/msg/Empty", "std_msgs/msg/Byte", "std_msgs/msg/Float64MultiArray"),
    *("sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "sensor_msgs/msg/PointCloud2"),
    *("tf2_msgs/msg/TFMessage", "visualization_msgs/msg/Marker", "diagnostic_msgs/msg/DiagnosticArray"),
)
CODECS: Final = tuple(codec_of(bus.MessageSchema.of(message_class(name))) for name in _READY_MADE)
CLASSES: Final = tuple(map(message_class, _READY_MADE))
WHEEL: Final = codec_of(bus.MessageSchema.of(Wheel))


def cdr(data: bytes) -> None:
    """A CDR message of a ready-made type: its class reads it and it comes back, or a CdrError."""
    script = Script(data)
    index = script.byte() % len(CODECS)
    with suppress(CdrError):
        payload = CODECS[index].decode(script.rest())
        msgspec.msgpack.decode(payload, type=CLASSES[index])
        assert CODECS[index].decode(b"".join(CODECS[index].encode(payload))) == payload


def wheels(data: bytes) -> None:
    """CDR messages and payloads of a class with all Python types: a message, or a CdrError."""
    script = Script(data)
    with suppress(CdrError):
        if script.byte() % 2:
            _encode(WHEEL, script.rest())
        else:
            msgspec.msgpack.decode(WHEEL.decode(script.rest()), strict=False)


def payloads(data: bytes) -> None:
    """A payload of a type that another process describes: readable CDR, or an error."""
    script = Script(data)
    payload = script.take(script.byte())
    decoders: tuple[Callable[[bytes], Any], ...] = (msgspec.json.decode, msgspec.msgpack.decode)
    try:
        description = msgspec.msgpack.encode(script.choose(decoders)(script.rest()))
    except (ValueError, TypeError, OverflowError, RecursionError):
        return
    with suppress(ConfigurationError, CdrError):
        codec = Codec(bus.MessageSchema("fuzz/msg/Fuzz", "", description))
        parsed = schema_of_definition(codec.type_name, codec.definition)
        assert parsed.type_hash == codec.type_hash
        _encode(codec, payload)
        codec.decode(b"\0\1\0\0" + payload)


def bag_definitions(data: bytes) -> None:
    """The definition of a type in a bag file: a type with the same description, or a ConfigurationError."""
    with suppress(ConfigurationError):
        schema = schema_of_definition("fuzz/msg/Fuzz", data.decode(errors="replace"))
        codec = Codec(schema)
        assert codec.type_hash == schema.type_hash
        assert schema_of_definition(codec.type_name, codec.definition).type_hash == schema.type_hash


def _encode(codec: Codec, payload: bytes) -> None:
    sent = b"".join(codec.encode(payload))
    with suppress(CdrError):  # for example a union, which is JSON with unchecked contents
        codec.decode(sent)

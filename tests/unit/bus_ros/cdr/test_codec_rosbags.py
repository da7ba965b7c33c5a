"""The types that come with busd, and a user's own type: rosbags has the same bytes, definitions and
hashes.
"""

from functools import partial
from typing import Any

import pytest

import bus
from bus.types.classes import message_class
from bus.types.definitions import names
from bus_ros.cdr import codec_of, schema_of_definition
from daily_types import daily_part
from ownclasses import Wheel
from payloads import payload
from rows import for_each

typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed: pip install rosbags")

MESSAGES = [name for name in names("msg") if name != "example_interfaces/msg/WString"]
"""All types, except the one that the codec refuses."""


def known_as(definition: str, name: str) -> Any:
    """A store of rosbags that knows the type, and all types in it, from the definition alone."""
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(definition, name))
    return store


@pytest.mark.landing
@for_each("name", partial(daily_part, MESSAGES))
def test_bytes_definition_and_hash_are_those_of_rosbags(name: str) -> None:
    schema = bus.MessageSchema.of(message_class(name))
    codec = codec_of(schema)
    assert (codec.type_name, codec.type_hash, codec.as_json) == (name, schema.type_hash, ())
    assert schema_of_definition(name, codec.definition).type_hash == schema.type_hash
    store = known_as(codec.definition, name)
    assert store.hash_rihs01(name) == schema.type_hash
    for seed in range(3):
        sent = payload(schema.description, seed)
        cdr = b"".join(codec.encode(sent))
        message = store.deserialize_cdr(cdr, name)
        assert bytes(store.serialize_cdr(message, name)) == cdr
        assert codec.decode(cdr) == sent
        assert codec.decode(bytes(store.serialize_cdr(message, name, little_endian=False))) == sent


def test_messages_of_own_classes_are_read_by_others() -> None:
    schema = bus.MessageSchema.of(Wheel)
    codec = codec_of(schema)
    store = known_as(codec.definition, codec.type_name)
    assert store.hash_rihs01(codec.type_name) == codec.type_hash
    for seed in range(20):
        cdr = b"".join(codec.encode(payload(schema.description, seed)))
        message = store.deserialize_cdr(cdr, codec.type_name)
        assert bytes(store.serialize_cdr(message, codec.type_name)) == cdr


def test_mcap_ros2_reads_them_too() -> None:
    decoding = pytest.importorskip("mcap_ros2._dynamic", reason="mcap-ros2-support is not installed")
    for cls in (Wheel, message_class("sensor_msgs/msg/PointCloud2")):
        schema = bus.MessageSchema.of(cls)
        codec = codec_of(schema)
        read = decoding.generate_dynamic(codec.type_name, codec.definition)[codec.type_name]
        cdr = b"".join(codec.encode(payload(schema.description, 3)))
        assert read(cdr) == read(cdr)
        assert [slot.lstrip("_") for slot in read(cdr).__slots__][:1] == [
            codec.definition.split("\n", 1)[0].split()[1]
        ]

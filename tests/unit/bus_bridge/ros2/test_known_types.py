"""bus_bridge.ros2.known_types: the types of far endpoints, by name and hash."""

import pytest

from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.known_types import KnownTypes

NAME = "std_msgs/msg/String"
SCHEMA = MessageSchema.of(message_class(NAME))


def test_a_far_type_is_known_by_its_name_and_its_hash() -> None:
    types = KnownTypes()
    known = types.find(NAME, "")  # Humble sends no hash
    assert known.schema == SCHEMA
    assert types.find(NAME, known.codec.type_hash) is known
    with pytest.raises(BridgeError, match="std_msgs/msg/String is another type in ROS 2"):
        types.find(NAME, "RIHS01_" + "0" * 64)
    with pytest.raises(BridgeError, match="unknown interface 'no/msg/Such'"):
        types.find("no/msg/Such", "")


def test_a_type_of_this_bus_is_known_once() -> None:
    types = KnownTypes()
    known = types.learn(SCHEMA)
    assert types.learn(SCHEMA) is known
    assert types.find(NAME, "") is known
    assert types.schema_of(SCHEMA.type_name, SCHEMA.type_hash) == SCHEMA
    with pytest.raises(BridgeError, match="no/msg/Such is not known here"):
        types.schema_of("no/msg/Such", "")

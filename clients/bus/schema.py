"""Descriptions of message types on the bus, for programs without a class."""

import re
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

import msgspec

from bus.errors import ConfigurationError, MessageTypeError
from bus.types.support import TypeSupport, find_type, type_hash, type_support, wrong_class

if TYPE_CHECKING:  # most programs don't need it
    from bus.graph import Graph

_DEPTH, _DEPTH_OF_ARRAYS, _DEPTH_OF_BULK = 1000, 200, 20
_BULK = ("uint8[]", "byte[]")
_NUMBER = r"u?int\d+|float\d+"


class MessageSchema(msgspec.Struct, frozen=True, dict=True):
    """A message type without a class: its name, its hash, and how its messages are encoded.

    For recorders, bridges and viewers: to subscribe, to publish, to inspect encoded messages. It comes from
    `Node.get_schema`, from the `schema` of an endpoint, or from a class.

        schema = bus.MessageSchema.of(String)
        publisher = await node.create_publisher(schema, "chatter")
        publisher.publish_encoded(bytes([0x91, 0xA2]) + b"hi")  # MessagePack
    """

    type_name: str
    """As `std_msgs/msg/String`."""
    type_hash: str
    """Hash of the description; ROS 2's hash if ROS 2 can describe the type. Types match if name and hash are
    equal."""
    encoded: bytes
    """The description as it travels: `description` in MessagePack."""

    @staticmethod
    def of(message_type: "type[msgspec.Struct] | Mapping[str, Any]") -> "MessageSchema":
        """The schema of a message class, or of a `description` (its hash is computed).

        Raises MessageTypeError if the class is not a message type, ConfigurationError for a description that
        is malformed or too large.
        """
        if isinstance(message_type, Mapping):
            from bus.types.schema import build

            message_type = build(message_type)
        return schema_of(type_support(message_type))

    @cached_property
    def description(self) -> dict[str, Any]:
        """`root` is the type's name, `types` has the fields of each type; see docs/any-type.md. Raises
        ConfigurationError if the description from the bus is malformed.
        """
        try:
            found: dict[str, Any] = msgspec.msgpack.decode(self.encoded, type=dict)
        except (ValueError, RecursionError) as error:
            text = f"the description of {self.type_name} on the bus is broken: {error}"
            raise ConfigurationError(text) from None
        return found

    def to_class(self) -> type[msgspec.Struct]:
        """A class for its messages: the ready-made class if its definition is the same, else a new class.

        Raises ConfigurationError if the description is malformed or too large.
        """
        ready_made = find_type(self.type_name)
        if ready_made is not None and type_hash(ready_made) == self.type_hash:
            return ready_made
        from bus.types.schema import build

        return build(self.description)


def schema_of(support: TypeSupport[Any]) -> MessageSchema:
    return MessageSchema(support.name, support.hash, support.description)


def depth_for(schema: MessageSchema) -> int:
    """The depth for a program that takes all messages of a topic, such as a recorder or a bridge.

    It is lower for types with arrays of numbers, and still lower for images and similar types, because the
    memory of their publishers grows with it. Raises ConfigurationError if the description is broken.
    """
    fields = [field["type"] for kind in schema.description["types"].values() for field in kind["fields"]]
    if any(field in _BULK for field in fields):
        return _DEPTH_OF_BULK
    if any(len(field) == 2 and field[0] == "list" and _is_number(field[1]) for field in fields):
        return _DEPTH_OF_ARRAYS
    return _DEPTH


def _is_number(field: object) -> bool:
    return isinstance(field, str) and re.fullmatch(_NUMBER, field) is not None


async def find_schema(
    graphs: "AsyncGenerator[Graph, None]",
    topic: str,
    type_name: str | None,
    get_schema: Callable[[str, str], Awaitable[MessageSchema]],
) -> MessageSchema | None:
    """Wait for the type of `topic`, or the type with that name; None if `graphs` ends first.

    Raises ConfigurationError if the topic has several types.
    """
    from bus.graph import types_of

    async for graph in graphs:
        found = types_of(graph, topic, type_name)
        if len(found) > 1:
            several = ", ".join(f"{name} ({number})" for name, number in found)
            raise ConfigurationError(f"topic '{topic}' has more than one type, name one: {several}")
        for kind in found:
            with suppress(ConfigurationError):  # it has gone meanwhile
                return await get_schema(*kind)
        if type_name is not None and (ready_made := find_type(type_name)) is not None:
            return MessageSchema.of(ready_made)
    return None


def support_of(schema: MessageSchema, *, raw: bool) -> TypeSupport[Any]:
    """The TypeSupport of a schema, for endpoints; `raw`: messages stay encoded."""
    if raw:
        return _EncodedSupport(schema)
    support = type_support(schema.to_class())
    if support.hash != schema.type_hash:  # the schema is from a program that describes types differently
        support.hash, support.description = schema.type_hash, schema.encoded
    return support


class _EncodedSupport(TypeSupport[Any]):
    """The TypeSupport for messages that stay bytes."""

    def __init__(self, schema: MessageSchema) -> None:
        self.cls = bytes
        self.name, self.hash, self.description = schema.type_name, schema.type_hash, schema.encoded
        self.encode = self.decode = bytes

    @cached_property
    def is_valid(self) -> Callable[[Any], bool]:
        return lambda message: True

    @cached_property
    def plan(self) -> Any:
        return None

    def explain(self, message: Any) -> MessageTypeError | None:
        return None if message.__class__ is bytes else wrong_class(bytes, message)

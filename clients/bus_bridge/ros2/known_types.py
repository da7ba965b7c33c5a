"""The message types that an engine can carry, in the forms of the bus, ROS 2 and cyclonedds.

Owns: the type for each name of ROS 2. A far type is known if its definition can be found, or if a node of
this bus has it.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

from bus.errors import ConfigurationError
from bus.schema import MessageSchema, depth_for
from bus_bridge.errors import BridgeError
from bus_ros.cdr import Codec, codec_of

__all__ = ["MOST_UNKNOWN", "TOO_MANY_UNKNOWN", "KnownType", "KnownTypes"]

MOST_UNKNOWN: Final = 1000
"""Most endpoints of unknown types that an engine keeps, because their types may become known."""
TOO_MANY_UNKNOWN: Final = (
    f"more than {MOST_UNKNOWN:,} endpoints of ROS 2 have types that are not known here: "
    "further ones are left out until they are created again"
)
"""A warning for the user."""


class KnownType:
    """One type in its three forms."""

    def __init__(self, schema: MessageSchema, make_idl: Callable[[Codec], Any] | None = None) -> None:
        self._make_idl = make_idl
        self.schema = schema
        self.codec: Codec = codec_of(schema)
        self.depth = depth_for(schema)
        """Number of messages that readers and writers keep."""

    @cached_property
    def idl(self) -> Any:
        """The class for cyclonedds. Raises BridgeError if it can't describe the type."""
        assert self._make_idl is not None
        return self._make_idl(self.codec)


class KnownTypes:
    """All types known so far. `make_idl` describes them for cyclonedds, if that must be able to."""

    def __init__(self, make_idl: Callable[[Codec], Any] | None = None) -> None:
        self._make_idl = make_idl
        self._by_schema: dict[tuple[str, str], KnownType] = {}
        self._by_ros_name: dict[str, KnownType] = {}

    def learn(self, schema: MessageSchema) -> KnownType:
        """Add the type of an endpoint of this bus. Raises BridgeError if ROS 2 can't have that type."""
        key = schema.type_name, schema.type_hash
        if (known := self._by_schema.get(key)) is None:
            try:
                known = KnownType(schema, self._make_idl)
                if self._make_idl is not None:
                    known.idl  # noqa: B018 - raises now, before any other step
            except ConfigurationError as error:
                raise BridgeError(f"{schema.type_name} can't go to ROS 2: {error}") from None
            self._by_schema[key] = known
            self._by_ros_name.setdefault(known.codec.type_name, known)
        return known

    def find(self, type_name: str, type_hash: str) -> KnownType:
        """The type of a far endpoint. An empty hash, as Humble sends it, fits any type.

        Raises BridgeError if the type is unknown, or differs from the type of the same name here.
        """
        known = self._by_ros_name.get(type_name)
        if known is None:
            from bus.types.classes import message_class
            from bus.types.definitions import exists

            try:
                if not exists(type_name):  # a far side may name any number of missing types
                    raise ConfigurationError(f"unknown interface '{type_name}'")
                known = self.learn(MessageSchema.of(message_class(type_name)))
            except ConfigurationError as error:
                raise BridgeError(
                    f"{error}: its topics are left out until its package is built in a workspace around the "
                    "bridge, or $BUS_INTERFACE_PATH has its definitions"
                ) from None
        if type_hash and type_hash != known.codec.type_hash:
            raise BridgeError(
                f"{type_name} is another type in ROS 2 ({_short(type_hash)}) than here "
                f"({_short(known.codec.type_hash)}): one side has an older definition"
            )
        return known

    def schema_of(self, type_name: str, type_hash: str) -> MessageSchema:
        """The schema of a type by its name on the bus. Raises BridgeError if it is not known."""
        if (known := self._by_schema.get((type_name, type_hash))) is None:
            raise BridgeError(f"{type_name} is not known here")
        return known.schema


def _short(type_hash: str) -> str:
    return type_hash[:19]

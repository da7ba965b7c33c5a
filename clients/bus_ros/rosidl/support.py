"""The TypeSupport of a rosidl-style class: on the bus it is the native class of the same name.

Owns: name, hash and schema (the native ones), and errors that name the field. Must not know: topics.
"""

import os
from collections.abc import Iterator
from functools import cache, cached_property
from operator import truth
from typing import Any

import msgspec

from bus.errors import ConfigurationError, MessageTypeError
from bus.types.check import plan
from bus.types.classes import message_class as native_class
from bus.types.support import ENCODE_ERRORS, TypeSupport, hash_and_description, wrong_class
from bus_ros.rosidl import fields
from bus_ros.rosidl.message import RosMessage
from bus_ros.rosidl.wire import codec

__all__ = ["RosTypeSupport", "support_of"]


class RosTypeSupport(TypeSupport[Any]):
    """Everything about one rosidl-style class; get it from `bus.types.support.type_support(cls)`.

    Setters have checked all assigned values, so `is_valid` returns True, and `encode` finds values put into
    lists later. If setters check nothing, `is_valid` encodes the message and decodes the result.
    """

    def __init__(self, cls: type[RosMessage]) -> None:
        native = native_class(cls.__type_name__)
        names = tuple(field.name for field in cls.__definition__.fields)
        if native.__struct_fields__ != names:
            raise ConfigurationError(
                f"the definition of {cls.__type_name__} here has other fields than the one of ROS 2: "
                f"{', '.join(names)}"
            )
        self.cls = cls
        self.name = cls.__type_name__
        self.hash, self.description = hash_and_description(native)
        self.encode, self.decode = codec(cls, native)
        if self.plan is not None:  # the plan decodes in half the time
            self.plan.decode_slowly, self.decode = self.decode, self.plan.decode
        # True for a message without its own method for it; this function is in C.
        self.is_valid = truth if os.environ.get("ROS_PYTHON_CHECK_FIELDS") != "0" else self._survives

    @cached_property
    def plan(self) -> Any:
        return plan(native_class(self.name), dict(_kinds(self.cls)))

    def _survives(self, message: RosMessage) -> bool:
        try:
            self.decode(self.encode(message))
        except (*ENCODE_ERRORS, msgspec.DecodeError):
            return False
        return True

    def explain(self, message: object) -> MessageTypeError | None:
        """The error that names the wrong field and its path, or None if the message is right."""
        if not isinstance(message, self.cls):
            return wrong_class(self.cls, message)
        try:
            self.decode(self.encode(message))
        except (*ENCODE_ERRORS, msgspec.DecodeError) as error:
            path, text = next(_mistakes(message, "$"), ("$", str(error)))
            return MessageTypeError(f"{self.name}: {text} - at `{path}`")
        return None


@cache
def support_of(cls: type[RosMessage]) -> RosTypeSupport:
    """The support of a class that was made from a definition."""
    return RosTypeSupport(cls)


def _kinds(cls: type[RosMessage]) -> Iterator[tuple[type, type]]:
    """The native classes of this class and of its nested ones, each with the class it belongs to."""
    yield native_class(cls.__type_name__), cls
    for nested in cls.__nested__.values():
        yield from _kinds(nested)


def _mistakes(message: RosMessage, path: str) -> Iterator[tuple[str, str]]:
    """The path of each wrong value, and the text of its error."""
    for field in message.__definition__.fields:
        here = f"{path}.{field.name}"
        try:
            value = getattr(message, field.name)
        except AttributeError:
            yield here, f"The '{field.name}' field was deleted"
            continue
        if field.name in message.__nested__:
            if isinstance(value, RosMessage):
                yield from _mistakes(value, here)
            elif field.type.array:
                for index, item in enumerate(value):
                    if isinstance(item, RosMessage):
                        yield from _mistakes(item, f"{here}[{index}]")
        try:
            fields.checker(field, message.__nested__.get(field.name), is_strict=True)(value)
            if isinstance(value, str):
                value.encode()
        except AssertionError as error:
            yield here, str(error)
        except UnicodeEncodeError as error:
            yield here, f"The '{field.name}' field is no text: {error}"

"""The base of the rosidl-style message classes: everything that does not depend on their fields.

Owns: printing and comparison of messages. Must not know: making classes, copying messages
(`bus_ros.rosidl.classes`), topics.
"""

from array import array
from typing import ClassVar

from bus.types.idl import Message as Definition
from bus_ros.rosidl import definition, fields, numbers

__all__ = ["RosMessage"]


class _SlotTypes:
    """`SLOT_TYPES`, made on access: few programs use it."""

    def __get__(self, instance: object, owner: "type[RosMessage]") -> tuple[definition.AbstractType, ...]:
        return tuple(fields.slot_type(field.type) for field in owner.__definition__.fields)


class RosMessage:
    """A message as rosidl generates it: one property per field, all keyword arguments optional.

    Assigning a value that can't be converted raises AssertionError, unless ROS_PYTHON_CHECK_FIELDS is 0.
    """

    __slots__: ClassVar[tuple[str, ...]] = ()

    __type_name__: ClassVar[str]
    __definition__: ClassVar[Definition]
    __nested__: ClassVar["dict[str, type[RosMessage]]"]
    """The classes of the fields that hold messages."""
    __generated__: ClassVar["type[RosMessage]"]
    """The class made from the definition: this class, or the base that a program's class derives from."""

    _fields_and_field_types: ClassVar[dict[str, str]]
    SLOT_TYPES: ClassVar[_SlotTypes] = _SlotTypes()

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Names of the fields and texts of their types, in order: `{'data': 'string'}`; a copy."""
        return dict(cls._fields_and_field_types)

    def __repr__(self) -> str:
        *package, _ = type(self).__module__.split(".")
        parts = ", ".join(
            f"{field.name}={_text(getattr(self, field.name))}" for field in self.__definition__.fields
        )
        return f"{'.'.join((*package, type(self).__name__))}({parts})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return False
        return all(
            numbers.same(getattr(self, field.name), getattr(other, field.name))
            for field in self.__definition__.fields
        )


def _text(value: object) -> str:
    if not isinstance(value, array):
        return repr(value)
    return repr(value.tolist())

"""The base of the rosidl-style message classes: what they all can do, whatever their fields are.

Owns: how a message is printed, compared, copied and pickled, and the way from a class to its TypeSupport.
Must not know: how classes are made (`bus_ros.rosidl.classes`), topics.
"""

from array import array
from typing import Any, ClassVar

from bus.types.idl import Message as Definition
from bus_ros.rosidl import fields, numbers

__all__ = ["RosMessage"]


class _SlotTypes:
    """`SLOT_TYPES`, made when somebody asks: few do."""

    def __get__(self, instance: object, owner: "type[RosMessage]") -> tuple[Any, ...]:
        return tuple(fields.slot_type(field.type) for field in owner.__definition__.fields)


class RosMessage:
    """A message as rosidl generates it: one property per field, all keyword arguments optional.

    Assigning what a field can't hold raises AssertionError, unless ROS_PYTHON_CHECK_FIELDS is 0.
    """

    __slots__: ClassVar[Any] = ()

    __type_name__: ClassVar[str]
    __definition__: ClassVar[Definition]
    __nested__: ClassVar["dict[str, type[RosMessage]]"]
    """The classes of the fields that hold messages."""
    __generated__: ClassVar["type[RosMessage]"]
    """This class, and for a class derived from it the one that was made of the definition."""
    __checks__: ClassVar[dict[str, fields.Check]]

    _fields_and_field_types: ClassVar[dict[str, str]]
    SLOT_TYPES: ClassVar[Any] = _SlotTypes()

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Names of the fields and texts of their types, in order: `{'data': 'string'}`; a copy."""
        return dict(cls._fields_and_field_types)

    @classmethod
    def __type_support__(cls) -> Any:
        """For `bus.types.support.type_support`."""
        # Most messages are only made and read, so what the wire needs isn't imported before.
        from bus_ros.rosidl.support import support_of

        generated: Any = cls.__generated__
        return support_of(generated)

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

    def __reduce__(self) -> tuple[Any, ...]:
        cls = type(self)
        # By its name: its module can be imported only where the import hook is installed.
        which = cls.__type_name__ if cls is cls.__generated__ else cls
        values = tuple(getattr(self, f"_{field.name}") for field in self.__definition__.fields)
        return _again, (which, values), getattr(self, "__dict__", None) or None


def _again(which: "str | type[RosMessage]", values: tuple[Any, ...]) -> RosMessage:
    from bus_ros.rosidl.classes import message_class

    cls = message_class(which) if isinstance(which, str) else which
    made: RosMessage = cls.__new__(cls)
    for field, value in zip(cls.__definition__.fields, values, strict=True):
        setattr(made, f"_{field.name}", value)
    return made


def _text(value: object) -> str:
    if not isinstance(value, array):
        return repr(value)
    return repr(value.tolist())

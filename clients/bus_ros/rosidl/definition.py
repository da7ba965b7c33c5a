"""The types of fields as values, for `SLOT_TYPES`; programs import it as `rosidl_parser.definition`.

Owns: the classes that programs use with `isinstance`, and their attributes. Must not know: message classes.
"""

from typing import Final

__all__ = [
    "BASIC_TYPES",
    "BOOLEAN_TYPE",
    "CHARACTER_TYPES",
    "EXPLICIT_INTEGER_TYPES",
    "FLOATING_POINT_TYPES",
    "INTEGER_TYPES",
    "OCTET_TYPE",
    "SIGNED_INTEGER_TYPES",
    "UNSIGNED_INTEGER_TYPES",
    "AbstractGenericString",
    "AbstractNestableType",
    "AbstractNestedType",
    "AbstractSequence",
    "AbstractString",
    "AbstractType",
    "AbstractWString",
    "Array",
    "BasicType",
    "BoundedSequence",
    "BoundedString",
    "BoundedWString",
    "NamedType",
    "NamespacedType",
    "UnboundedSequence",
    "UnboundedString",
    "UnboundedWString",
]

SIGNED_INTEGER_TYPES: Final = ("int8", "int16", "int32", "int64")
UNSIGNED_INTEGER_TYPES: Final = ("uint8", "uint16", "uint32", "uint64")
EXPLICIT_INTEGER_TYPES: Final = SIGNED_INTEGER_TYPES + UNSIGNED_INTEGER_TYPES
INTEGER_TYPES: Final = EXPLICIT_INTEGER_TYPES
FLOATING_POINT_TYPES: Final = ("float", "double", "long double")
CHARACTER_TYPES: Final = ("char", "wchar")
BOOLEAN_TYPE: Final = "boolean"
OCTET_TYPE: Final = "octet"
BASIC_TYPES: Final = (*INTEGER_TYPES, *FLOATING_POINT_TYPES, *CHARACTER_TYPES, BOOLEAN_TYPE, OCTET_TYPE)


class AbstractType:
    """Base of all types; equal to another object of its class with the same attributes."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and _attributes(other) == _attributes(self)

    def __hash__(self) -> int:
        return hash((type(self).__name__, *map(str, _attributes(self))))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(map(repr, _attributes(self)))})"

    def has_maximum_size(self) -> bool:
        """Whether its length is bounded."""
        return False


class AbstractNestableType(AbstractType):
    """A type that can be the element of an array or a sequence."""

    __slots__ = ()


class BasicType(AbstractNestableType):
    """A number, a boolean or an octet; `typename` is IDL's name: `double`, `boolean`, `octet`, `uint8`."""

    __slots__ = ("typename",)

    def __init__(self, typename: str) -> None:
        self.typename = typename


class NamedType(AbstractNestableType):
    """A type by its name alone."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name


class NamespacedType(AbstractNestableType):
    """Another message: `namespaces` is `["std_msgs", "msg"]`, `name` is `Header`."""

    __slots__ = ("name", "namespaces")

    def __init__(self, namespaces: list[str], name: str) -> None:
        self.namespaces = namespaces
        self.name = name

    def namespaced_name(self) -> tuple[str, ...]:
        """All parts of the name."""
        return (*self.namespaces, self.name)


class AbstractGenericString(AbstractNestableType):
    """A text, wide or not."""

    __slots__ = ()


class AbstractString(AbstractGenericString):
    """A text."""

    __slots__ = ()


class AbstractWString(AbstractGenericString):
    """A wide text."""

    __slots__ = ()


class UnboundedString(AbstractString):
    """`string`"""

    __slots__ = ()


class UnboundedWString(AbstractWString):
    """`wstring`"""

    __slots__ = ()


class BoundedString(AbstractString):
    """`string<=N`"""

    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class BoundedWString(AbstractWString):
    """`wstring<=N`"""

    __slots__ = ("maximum_size",)

    def __init__(self, maximum_size: int) -> None:
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class AbstractNestedType(AbstractType):
    """Several values of one type, `value_type`."""

    __slots__ = ("value_type",)

    def __init__(self, value_type: AbstractNestableType) -> None:
        self.value_type = value_type


class Array(AbstractNestedType):
    """`T[N]`"""

    __slots__ = ("size",)

    def __init__(self, value_type: AbstractNestableType, size: int) -> None:
        super().__init__(value_type)
        self.size = size

    def has_maximum_size(self) -> bool:
        return True


class AbstractSequence(AbstractNestedType):
    """A sequence, bounded or not."""

    __slots__ = ()


class BoundedSequence(AbstractSequence):
    """`T[<=N]`"""

    __slots__ = ("maximum_size",)

    def __init__(self, value_type: AbstractNestableType, maximum_size: int) -> None:
        super().__init__(value_type)
        self.maximum_size = maximum_size

    def has_maximum_size(self) -> bool:
        return True


class UnboundedSequence(AbstractSequence):
    """`T[]`"""

    __slots__ = ()


def _attributes(value: AbstractType) -> list[object]:
    return [
        getattr(value, slot)
        for cls in reversed(type(value).__mro__)
        for slot in sorted(getattr(cls, "__slots__", ()), reverse=True)
    ]

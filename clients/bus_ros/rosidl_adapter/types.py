"""Types of fields: their text, and their parts."""

from bus_ros.rosidl_adapter.names import (
    ARRAY_UPPER_BOUND_TOKEN,
    PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR,
    PRIMITIVE_TYPES,
    STRING_UPPER_BOUND_TOKEN,
    VALID_MESSAGE_NAME_PATTERN,
    VALID_PACKAGE_NAME_PATTERN,
    InvalidResourceName,
    is_valid_message_name,
    is_valid_package_name,
)

__all__ = ["BaseType", "Type"]

_BOUNDED_TEXTS = tuple(f"{kind}{STRING_UPPER_BOUND_TOKEN}" for kind in ("string", "wstring"))


class BaseType:
    """The type of one value: a primitive (`pkg_name` is None), or a message.

    `Point` of a message's own package needs `context_package_name`. Raises InvalidResourceName for an invalid
    name, TypeError for an invalid length of a text.
    """

    __slots__ = ["pkg_name", "string_upper_bound", "type"]

    def __init__(self, type_string: str, context_package_name: str | None = None) -> None:
        self.pkg_name: str | None = None
        self.type = type_string
        self.string_upper_bound: int | None = None
        if type_string in PRIMITIVE_TYPES:
            return
        if type_string.startswith(_BOUNDED_TEXTS):
            self.type, _, bound = type_string.partition(STRING_UPPER_BOUND_TOKEN)
            fault = f"the upper bound of the string type '{type_string}' must be a valid integer value > 0"
            self.string_upper_bound = _size(bound, fault)
            return
        parts = type_string.split(PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR)
        if len(parts) == 1 and context_package_name is not None:
            parts.insert(0, context_package_name)
        if len(parts) != 2:
            raise InvalidResourceName(type_string)
        self.pkg_name, self.type = parts
        _check_names(*parts)

    def is_primitive_type(self) -> bool:
        return self.pkg_name is None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, BaseType):
            return False
        return (self.pkg_name, self.type, self.string_upper_bound) == (
            other.pkg_name,
            other.type,
            other.string_upper_bound,
        )

    def __hash__(self) -> int:
        return hash(str(self))

    def __str__(self) -> str:
        if self.pkg_name is not None:
            return f"{self.pkg_name}{PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR}{self.type}"
        if self.string_upper_bound:
            return f"{self.type}{STRING_UPPER_BOUND_TOKEN}{self.string_upper_bound}"
        return self.type


class Type(BaseType):
    """The type of a field: as BaseType, and perhaps an array `T[]`, `T[3]` or `T[<=3]`.

    Raises TypeError for an invalid size, else as BaseType.
    """

    __slots__ = ["array_size", "is_array", "is_upper_bound"]

    def __init__(self, type_string: str, context_package_name: str | None = None) -> None:
        self.is_array = type_string.endswith("]")
        self.is_upper_bound = False
        self.array_size: int | None = None
        element = type_string
        if self.is_array:
            element, bracket, size = type_string[:-1].rpartition("[")
            if not bracket:
                raise TypeError(f"the type ends with ']' but does not contain a '[': '{type_string}'")
            if size:
                self.is_upper_bound = size.startswith(ARRAY_UPPER_BOUND_TOKEN)
                fault = (
                    f"the size of array type '{type_string}' must be a valid integer value > 0 "
                    f"optionally prefixed with '{ARRAY_UPPER_BOUND_TOKEN}' if it is only an upper bound"
                )
                self.array_size = _size(size.removeprefix(ARRAY_UPPER_BOUND_TOKEN), fault)
        super().__init__(element, context_package_name)

    def is_dynamic_array(self) -> bool:
        """Whether it is an array whose size may change."""
        return self.is_array and (not self.array_size or self.is_upper_bound)

    def is_fixed_size_array(self) -> bool:
        return bool(self.is_array and self.array_size and not self.is_upper_bound)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Type):
            return False
        return super().__eq__(other) and (self.is_array, self.array_size, self.is_upper_bound) == (
            other.is_array,
            other.array_size,
            other.is_upper_bound,
        )

    def __hash__(self) -> int:
        return hash(str(self))

    def __str__(self) -> str:
        text = super().__str__()
        if not self.is_array:
            return text
        bound = ARRAY_UPPER_BOUND_TOKEN if self.is_upper_bound else ""
        return f"{text}[{bound}{'' if self.array_size is None else self.array_size}]"


def _size(text: str, fault: str) -> int:
    try:
        size = int(text)
    except ValueError:
        raise TypeError(fault) from None
    if size <= 0:
        raise TypeError(fault)
    return size


def _check_names(package: str, message: str) -> None:
    if not is_valid_package_name(package):
        raise InvalidResourceName(
            f"'{package}' is an invalid package name. "
            f"It should have the pattern '{VALID_PACKAGE_NAME_PATTERN.pattern}'"
        )
    if not is_valid_message_name(message):
        raise InvalidResourceName(
            f"'{message}' is an invalid message name. "
            f"It should have the pattern '{VALID_MESSAGE_NAME_PATTERN.pattern}'"
        )

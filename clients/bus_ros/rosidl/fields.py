"""Fields of messages: their types as texts and as values, and the checks of assignments.

Owns: the assertions, with rosidl's texts, and the stored form of a value. An integer is not a float, as in
ROS; a scalar of numpy counts as the Python value of the same type. Any iterable of numbers becomes an array,
unless the checks are strict. Must not know: the making of classes, the wire.
"""

from array import array
from collections import UserString
from collections.abc import Callable, Collection, Iterable, Sequence, Set
from math import isinf
from typing import Any, Final, TypeAlias, TypeGuard

from bus.types.idl import INTEGERS, Field, Type
from bus_ros.rosidl import definition, numbers

__all__ = ["FLOAT32_MOST", "Check", "checker", "is_numeric", "loose", "slot_type", "type_text"]

Check: TypeAlias = Callable[[object], object]
"""Takes the assigned value, returns the value to store; raises AssertionError."""

FLOAT32_MOST: Final = 3.4028234663852886e38
_FLOAT32_TEXT: Final = 3.402823466e38
"""The bound in rosidl's text. rosidl refuses the greatest numbers of single precision; here they are valid.
"""
_FLOAT64_TEXT: Final = 1.7976931348623157e308

_IDL_NAMES: Final = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}
_CLASSES: Final[dict[str, type]] = {"bool": bool, "float32": float, "float64": float}
_OCTETS: Final = (bytes, bytearray, memoryview)


def is_numeric(type_: Type) -> bool:
    """Whether it is an array or a sequence of numbers."""
    return type_.array != "" and type_.base in numbers.CODES


def type_text(type_: Type) -> str:
    """The text in `get_fields_and_field_types`: `sequence<double>`, `geometry_msgs/Point`."""
    text = _IDL_NAMES.get(type_.base, type_.base)
    if "/" in text:
        text = f"{text.split('/')[0]}/{text.split('/')[-1]}"
    if type_.string_bound is not None:
        text += f"<{type_.string_bound}>"
    match type_.array:
        case "fixed":
            return f"{text}[{type_.size}]"
        case "bounded":
            return f"sequence<{text}, {type_.size}>"
        case "unbounded":
            return f"sequence<{text}>"
    return text


def slot_type(type_: Type) -> definition.AbstractType:
    """The value in `SLOT_TYPES`."""
    element: definition.AbstractNestableType
    if "/" in type_.base:
        *namespaces, name = type_.base.split("/")
        element = definition.NamespacedType(namespaces, name)
    elif type_.base == "string":
        bound = type_.string_bound
        element = definition.UnboundedString() if bound is None else definition.BoundedString(bound)
    elif type_.base == "wstring":
        bound = type_.string_bound
        element = definition.UnboundedWString() if bound is None else definition.BoundedWString(bound)
    else:
        element = definition.BasicType(_IDL_NAMES.get(type_.base, type_.base))
    match type_.array:
        case "fixed":
            return definition.Array(element, type_.size)
        case "bounded":
            return definition.BoundedSequence(element, type_.size)
        case "unbounded":
            return definition.UnboundedSequence(element)
    return element


def loose(type_: Type) -> Callable[[Any], object] | None:
    """The conversion of a value if nothing is checked; None if there is none."""
    if not is_numeric(type_):
        return None
    code = numbers.CODES[type_.base]
    if type_.array == "fixed":
        return lambda value: value if numbers.is_array(value) else numbers.fixed(code)(value)
    return lambda value: value if value.__class__ is array else numbers.sequence(code, value)


def checker(field: Field, message_class: type | None, *, is_strict: bool) -> Check:
    """The check of one field; `message_class` is the class of the messages in it.

    `is_strict`: as rosidl with ROS_PYTHON_CHECK_FIELDS=1. Otherwise sequences are converted, and the messages
    in a sequence are only checked when they are encoded.
    """
    type_ = field.type
    expected = message_class or _class_of(type_.base)
    if not type_.array:
        return _scalar(field.name, type_, expected)
    if type_.base in numbers.CODES:
        return _numeric(field.name, type_, expected, is_strict=is_strict)
    return _several(field.name, type_, expected, is_strict=is_strict)


def _class_of(base: str) -> type:
    return bytes if base == "byte" else str if base.endswith("string") else _CLASSES.get(base, int)


def _scalar(name: str, type_: Type, expected: type) -> Check:
    begin = f"The '{name}' field must be "
    if "/" in type_.base:
        return _instance(f"{begin}a sub message of type '{expected.__name__}'", expected)
    if type_.base == "byte":

        def octet(value: object) -> object:
            if not isinstance(value, _OCTETS) or len(value) != 1:
                raise AssertionError(f"{begin}of type 'bytes' or 'ByteString' with length 1")
            return value

        return octet
    if type_.string_bound is not None:
        bound = type_.string_bound

        def bounded(value: object) -> object:
            if not isinstance(value, str | UserString) or len(value) > bound:
                raise AssertionError(f"{begin}string value not longer than {bound}")
            return str(value)

        return bounded
    if expected is int:
        return _integer(begin, type_.base)
    if type_.base == "float32":
        return _float32(begin)
    return _instance(f"{begin}of type '{expected.__name__}'", expected)


def _instance(text: str, expected: type) -> Check:
    def instance(value: object) -> object:
        value = numbers.plain(value)
        if not isinstance(value, expected):
            raise AssertionError(text)
        return value

    return instance


def _integer(begin: str, base: str) -> Check:
    least, most = INTEGERS[base]
    what = "an unsigned integer" if least == 0 else "an integer"

    def integer(value: object) -> object:
        value = numbers.plain(value)
        if not isinstance(value, int):
            raise AssertionError(f"{begin}of type 'int'")
        if not least <= value <= most:
            raise AssertionError(f"{begin}{what} in [{least}, {most}]")
        return int(value) if value is True or value is False else value

    return integer


def _float32(begin: str) -> Check:
    def float32(value: object) -> object:
        value = numbers.plain(value)
        if not isinstance(value, float):
            raise AssertionError(f"{begin}of type 'float'")
        if abs(value) > FLOAT32_MOST and not isinf(value):
            raise AssertionError(f"{begin}a float in [{-_FLOAT32_TEXT}, {_FLOAT32_TEXT}]")
        return value

    return float32


def _several(name: str, type_: Type, expected: type, *, is_strict: bool) -> Check:
    """The check for several texts, booleans, octets or messages: stores a list, or the given sequence."""
    text = _text(name, type_, expected)
    looks_at_items = is_strict or "/" not in type_.base
    only, of_class = frozenset((expected,)), _OCTETS if expected is bytes else expected

    def several(value: object) -> object:
        if numbers.is_array(value):
            value = value.tolist()
        elif isinstance(value, bytes) and expected is bytes:
            value = [value[index : index + 1] for index in range(len(value))]
        elif not is_strict and not _is_collection(value) and _is_iterable(value):
            value = list(value)
        if not _is_collection(value) or not _fits(type_, len(value)):
            raise AssertionError(text)
        if not looks_at_items:
            return value
        if not only.issuperset(map(type, value)) and not all(isinstance(item, of_class) for item in value):
            raise AssertionError(text)
        if expected is bytes and any(len(item) != 1 for item in value):
            raise AssertionError(text)
        if type_.string_bound is not None and any(len(item) > type_.string_bound for item in value):
            raise AssertionError(text)
        return value

    return several


def _numeric(name: str, type_: Type, expected: type, *, is_strict: bool) -> Check:
    """The check for several numbers: stores an array."""
    text = _text(name, type_, expected)
    code = numbers.CODES[type_.base]
    only = frozenset((expected,))
    is_fixed, is_unbounded = type_.array == "fixed", type_.array == "unbounded"
    of_numbers = memoryview, array, bytes, bytearray

    def looked_at(value: object) -> Iterable[Any]:
        if not is_strict:
            if not _is_iterable(value):
                raise AssertionError(text)
            return value if isinstance(value, of_numbers) else list(value)
        if not numbers.is_array(value) and not _is_collection(value):
            raise AssertionError(text)
        given: Iterable[Any] = value
        is_plain = numbers.is_array(value) or isinstance(value, of_numbers)
        if not (is_plain or only.issuperset(map(type, given))):
            given = [numbers.plain(item) for item in given]
            if not all(isinstance(item, expected) for item in given):
                raise AssertionError(text)
        return list(given) if isinstance(given, Set) else given

    def made_of(value: object) -> object:
        given: Iterable[Any]
        try:
            if value.__class__ is list and only.issuperset(map(type, value)):  # the usual case
                given, made = value, array(code, value)
            else:
                flat = value.ravel() if numbers.is_array(value) else value
                made = numbers.sequence(code, given := looked_at(flat))
        except (OverflowError, TypeError, ValueError):
            raise AssertionError(text) from None
        if not (is_unbounded or _fits(type_, len(made))) or (code == "f" and _has_overflowed(made, given)):
            raise AssertionError(text)
        return numbers.fixed(code)(made) if is_fixed else made

    def sequence(value: object) -> object:
        if not isinstance(value, array):
            return made_of(value)
        if value.typecode != code:
            if not is_strict:
                return made_of(value)
            raise AssertionError(f"The '{name}' array.array() must have the type code of '{code}'")
        if not _fits(type_, len(value)):
            raise AssertionError(f"The '{name}' array.array() must have a size <= {type_.size}")
        return value

    def fixed(value: object) -> object:
        if not numbers.is_array(value):
            return made_of(value)
        numpy = numbers.numpy()
        assert numpy is not None
        dtype = numpy.dtype(code)
        if value.dtype != dtype:
            if not is_strict:
                return made_of(value)
            raise AssertionError(f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype}'")
        if value.size != type_.size:
            raise AssertionError(f"The '{name}' numpy.ndarray() must have a size of {type_.size}")
        return value if value.ndim == 1 else value.ravel()

    return fixed if is_fixed else sequence


def _has_overflowed(made: "array[float]", value: Iterable[float]) -> bool:
    """Whether a large finite number has become infinite."""
    return any(isinf(new) and not isinf(old) for new, old in zip(made, value, strict=False))


def _is_collection(value: object) -> TypeGuard[Collection[Any]]:
    return isinstance(value, Sequence | Set) and not isinstance(value, str | UserString)


def _is_iterable(value: object) -> TypeGuard[Iterable[Any]]:
    return isinstance(value, Iterable) and not isinstance(value, str | UserString)


def _fits(type_: Type, length: int) -> bool:
    match type_.array:
        case "fixed":
            return length == type_.size
        case "bounded":
            return length <= type_.size
    return True


def _text(name: str, type_: Type, expected: type) -> str:
    parts = [f"The '{name}' field must be a set or sequence"]
    if type_.array != "unbounded":
        parts.append(f"with length {'' if type_.array == 'fixed' else '<= '}{type_.size}")
    if type_.string_bound is not None:
        parts.append(f"and each string value not longer than {type_.string_bound}")
    parts.append(f"and each value of type '{expected.__name__}'")
    if expected is float:
        most = _FLOAT32_TEXT if type_.base == "float32" else _FLOAT64_TEXT
        parts.append(f"and each {_IDL_NAMES[type_.base]} in [{-most:f}, {most:f}]")
    elif expected is int:
        least, most = INTEGERS[type_.base]
        parts.append(f"and each {'unsigned ' if least == 0 else ''}integer in [{least}, {most}]")
    return " ".join(parts)

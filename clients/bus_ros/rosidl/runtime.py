"""Messages as plain values and back; programs import it as `rosidl_runtime_py.convert`.

Owns: the conversions. Must not know: the making of classes, the places of definitions, topics.
"""

import sys
from array import array
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

from bus.types.idl import Type
from bus_ros.rosidl import numbers
from bus_ros.rosidl.definition import AbstractType, AbstractWString, BasicType, NamespacedType
from bus_ros.rosidl.fields import slot_type
from bus_ros.rosidl.message import RosMessage

__all__ = [
    "get_message_slot_types",
    "message_to_csv",
    "message_to_ordereddict",
    "message_to_yaml",
    "set_message_fields",
]


_Stamp: TypeAlias = Callable[[RosMessage], None]


def message_to_ordereddict(
    msg: RosMessage | bytes, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> "OrderedDict[str, Any]":
    """The fields of a message as plain values.

    Texts and arrays are cut after `truncate_length` characters or elements. `no_arr` and `no_str` replace the
    values by a description.
    """
    if isinstance(msg, bytes):
        return OrderedDict(bytes=msg)
    converted: OrderedDict[str, Any] = OrderedDict()
    for field in msg.__definition__.fields:
        value = getattr(msg, field.name)
        if no_arr and field.type.array:
            converted[field.name] = _array_text(field.type, len(value))
        else:
            converted[field.name] = _plain(value, truncate_length, no_arr, no_str)
    return converted


def message_to_yaml(
    msg: RosMessage | bytes,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """The fields of a message as YAML, with a line end at the end."""
    import yaml

    values = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    text: str = yaml.safe_dump(
        _without_order(values),
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow_style,
        sort_keys=False,
    )
    return text


def message_to_csv(
    msg: RosMessage | bytes, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> str:
    """The values of a message in one line, with commas between them."""
    if isinstance(msg, bytes):
        return str(msg)
    values = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    return ",".join(_flat(values))


def get_message_slot_types(msg: RosMessage) -> "OrderedDict[str, AbstractType]":
    """The types of a message's fields, as values of `rosidl_parser.definition`."""
    return OrderedDict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))


def set_message_fields(
    msg: RosMessage,
    values: Mapping[str, object],
    expand_header_auto: bool = False,
    expand_time_now: bool = False,
) -> list[_Stamp]:
    """Set the fields of a message from plain values, nested ones too.

    Returns setters for stamps to be filled in later: a Header given as `auto`, a Time given as `now`. Each is
    a function of one Time. Raises TypeError for a value that is no dictionary, AttributeError for an unknown
    field, AssertionError or ValueError for a wrong value.
    """
    stamps: list[_Stamp] = []
    _set(msg, values, stamps, expand_header_auto, expand_time_now)
    return stamps


def _set(msg: RosMessage, values: object, stamps: list[_Stamp], auto: bool, now: bool) -> None:
    if not isinstance(values, dict):
        raise TypeError(f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}")
    for name, value in values.items():
        current = getattr(msg, name)
        nested = msg.__nested__.get(name)
        if nested is None:
            setattr(msg, name, _as_type_of(current, value))
        elif not isinstance(current, RosMessage):
            setattr(msg, name, [_made(nested, item, stamps, auto, now) for item in value])
        elif auto and value == "auto" and nested.__type_name__ == "std_msgs/msg/Header":
            stamps.append(partial(setattr, current, "stamp"))
        elif now and value == "now" and nested.__type_name__ == "builtin_interfaces/msg/Time":
            stamps.append(partial(setattr, msg, name))
        elif isinstance(value, nested):
            setattr(msg, name, value)
        else:
            _set(current, value, stamps, auto, now)


def _made(cls: type[RosMessage], value: object, stamps: list[_Stamp], auto: bool, now: bool) -> RosMessage:
    if isinstance(value, cls):
        return value
    made = cls()
    _set(made, value, stamps, auto, now)
    return made


def _as_type_of(current: object, value: Any) -> object:
    """A value for a field that now holds `current`: a whole number is converted for a float field."""
    if isinstance(current, array):
        return value if isinstance(value, array) else numbers.sequence(current.typecode, value)
    if numbers.is_array(current):
        numpy = numbers.numpy()
        assert numpy is not None
        return numpy.array(value, dtype=current.dtype)
    if type(value) is type(current):
        return value
    if isinstance(current, bytes) and isinstance(value, int):
        return bytes((value,))
    if isinstance(current, bool | bytes):
        return value  # a text is not a truth value: the setter reports it
    of: Callable[[object], object] = type(current)
    return of(value)


def _array_text(type_: Type, length: int) -> str:
    whole: Any = slot_type(type_)
    element = _element_text(whole.value_type)
    match type_.array:
        case "fixed":
            return f"<array type: {element}[{type_.size}]>"
        case "bounded":
            return f"<sequence type: {element}[{type_.size}], length: {length}>"
    return f"<sequence type: {element}, length: {length}>"


def _element_text(type_: AbstractType) -> str:
    if isinstance(type_, NamespacedType):
        return "/".join(type_.namespaced_name())
    if isinstance(type_, BasicType):
        return type_.typename
    return "wstring" if isinstance(type_, AbstractWString) else "string"


def _plain(value: object, limit: int | None, no_arr: bool, no_str: bool) -> object:
    if isinstance(value, RosMessage):
        return message_to_ordereddict(value, truncate_length=limit, no_arr=no_arr, no_str=no_str)
    if isinstance(value, bytes | bytearray | memoryview):
        return _cut(bytes(value).decode("latin-1"), limit)
    if isinstance(value, str):
        return f"<string length: <{len(value)}>>" if no_str else _cut(value, limit)
    if not isinstance(value, list | tuple | set | array) and not numbers.is_array(value):
        return value
    items = value.tolist() if hasattr(value, "tolist") else list(value)
    kept = items if limit is None else items[:limit]
    shown = [_plain(item, limit, no_arr, no_str) for item in kept]
    return shown if len(kept) == len(items) else [*shown, "..."]


def _cut(text: str, limit: int | None) -> str:
    return text if limit is None or len(text) <= limit else f"{text[:limit]}..."


def _without_order(value: object) -> object:
    if isinstance(value, dict):
        return {name: _without_order(item) for name, item in value.items()}
    return [_without_order(item) for item in value] if isinstance(value, list) else value


def _flat(value: object) -> list[str]:
    if isinstance(value, dict):
        return [text for item in value.values() for text in _flat(item)]
    if isinstance(value, list):
        return [text for item in value for text in _flat(item)]
    return [str(value)]

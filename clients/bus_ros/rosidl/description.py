"""A definition as a type_description_interfaces/msg/TypeDescription, which other nodes can request.

Owns the content of that message. Must not know nodes or services.
"""

from collections.abc import Iterator
from typing import Any, Final

from bus.types.classes import message_class as native_class
from bus.types.definitions import definition_path, find_message
from bus.types.hash import schema_hash
from bus.types.idl import PARTS, Field, Message, Type
from bus.types.schema import describe as schema_of
from bus_ros.rosidl.classes import message_class

__all__ = ["describe", "service_hash", "sources_of"]

_PACKAGE: Final = "type_description_interfaces/msg"
_NAMES: Final = {"bool": "BOOLEAN", "float32": "FLOAT", "float64": "DOUBLE", "char": "UINT8"}
"""FIELD_TYPE_ names that differ from the type's upper case; rosidl makes a .msg file's char a uint8."""
_SUFFIXES: Final = {
    "": "",
    "fixed": "_ARRAY",
    "bounded": "_BOUNDED_SEQUENCE",
    "unbounded": "_UNBOUNDED_SEQUENCE",
}

_UINT8: Final = Type("uint8")


def describe(name: str) -> Any:
    """The TypeDescription of a message. Raises ConfigurationError if it has no definition."""
    first, *others = _with_nested(name)
    return _made(
        "TypeDescription",
        type_description=_described(first),
        referenced_type_descriptions=[
            _described(one) for one in sorted(others, key=lambda message: message.name)
        ],
    )


def sources_of(name: str) -> list[Any]:
    """A TypeSource for the file of each definition that the message needs."""
    first, *others = (message.name for message in _with_nested(name))
    found = []
    for one in (first, *sorted(others)):
        package, kind, short = one.split("/")
        # All messages of a service or an action are in its file.
        path = definition_path(f"{package}/{kind}/{short.partition('_')[0]}" if kind in PARTS else one)
        text = path.read_text("utf-8")
        found.append(_made("TypeSource", type_name=one, encoding=kind, raw_file_contents=text))
    return found


def service_hash(name: str) -> str:
    """ROS 2's hash of a service: over its request, its response and its event.

    Raises ConfigurationError if it has no definition.
    """
    parts = {f"{part}_message": f"{name}_{part.capitalize()}" for part in ("request", "response", "event")}
    types: dict[str, Any] = {}
    for part in parts.values():
        types |= schema_of(native_class(part))["types"]
    fields = [{"name": field, "type": part} for field, part in parts.items()]
    return schema_hash({"root": name, "types": {**types, name: {"array": True, "fields": fields}}})


def _with_nested(name: str) -> list[Message]:
    """The message, followed by its nested messages."""
    found: dict[str, Message] = {}

    def add(name: str) -> None:
        if name not in found:
            found[name] = find_message(name)
            for field in found[name].fields:
                if "/" in field.type.base:
                    add(field.type.base)

    add(name)
    return list(found.values())


def _described(message: Message) -> Any:
    return _made("IndividualTypeDescription", type_name=message.name, fields=list(_fields(message)))


def _fields(message: Message) -> Iterator[Any]:
    for field in message.fields:
        default = "" if field.default is None else str(_as_rosidl(field, field.default))
        yield _made("Field", name=field.name, type=_field_type(field), default_value=default)
    if not message.fields:  # IDL has no empty struct
        yield _made("Field", name="structure_needs_at_least_one_member", type=_field_type(Field("", _UINT8)))


def _field_type(field: Field) -> Any:
    made = _made("FieldType")
    base, bound, array, size = field.type
    word = "NESTED_TYPE" if "/" in base else _NAMES.get(base, base.upper())
    word = word if bound is None else f"BOUNDED_{word}"
    made.type_id = getattr(made, f"FIELD_TYPE_{word}{_SUFFIXES[array]}")
    made.capacity = size
    made.string_capacity = bound or 0
    made.nested_type_name = base if "/" in base else ""
    return made


def _as_rosidl(field: Field, value: Any) -> Any:
    """A default value as rosidl has it: a byte is a number."""
    if isinstance(value, tuple):
        return tuple(_as_rosidl(field, one) for one in value)
    return value[0] if isinstance(value, bytes) else value


def _made(name: str, /, **fields: Any) -> Any:
    cls: Any = message_class(f"{_PACKAGE}/{name}")
    return cls(**fields)

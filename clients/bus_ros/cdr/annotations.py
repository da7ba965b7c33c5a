"""The types by which msgspec checks and decodes payloads, as the generated functions expect them.

Owns: one annotation for each shape. A message is a tuple of its fields, or a small struct if the payload has
a map. Must not know: CDR.
"""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, Raw, UnsetType

from bus.types.schema import build
from bus_ros.cdr.shapes import Bytes, Dict, Json, Message, Optional, Primitive, Sequence, Shape, Wrapped

__all__ = ["Annotations", "field_name", "json_annotation"]

_KINDS: Final[dict[str, Any]] = {
    **dict.fromkeys(("float32", "float64"), float),
    "bool": bool,
    "byte": Annotated[bytes, Meta(min_length=1, max_length=1)],
    "string": str,
}


def field_name(index: int) -> str:
    """The name of a field in the struct that represents a map."""
    return f"f{index}"


def json_annotation(description: Mapping[str, Any], node: Any) -> Any:
    """The annotation for JSON texts with values of the type `node` of the schema."""
    root = "busd/msg/Value"
    fields = [{"name": "value", "type": node, "required": True}]
    value = {"array": True, "fields": fields}
    made = build({"root": root, "types": {**description["types"], root: value}})
    return msgspec.structs.fields(made)[0].type


class Annotations:
    """Annotations of one schema's shapes. With `views`, bytes are views of the payload, and texts Raw."""

    def __init__(self, description: Mapping[str, Any], views: bool) -> None:
        self._description = description
        self._views = views
        self._plain: Annotations = Annotations(description, False) if views else self
        self._made: dict[Message, Any] = {}

    def of(self, shape: Shape) -> Any:
        match shape:
            case Primitive("string"):
                return Raw if self._views else str
            case Primitive(kind):
                return _KINDS.get(kind, int)
            case Bytes(size, most):
                return _limited(memoryview if self._views else bytes, size, most)
            case Sequence(item, size, most):
                return _limited(_generic(list, self.of(item)), size, most)
            case Optional(item, can_be_absent):
                # msgspec does not accept a union of Raw and other types.
                inner = (self._plain if item == Primitive("string") else self).of(item)
                return inner | UnsetType if can_be_absent else inner | None
            case Dict(key, value):
                # A view can't always be the key of a dict.
                return _generic(dict, (self._plain.of(key), self.of(value)))
            case Wrapped(item):
                return self.of(item)
            case Json():
                return Any
            case Message():
                if shape not in self._made:
                    self._made[shape] = self._message(shape)
                return self._made[shape]
        raise AssertionError(shape)

    def _message(self, shape: Message) -> Any:
        if shape.is_array:
            items = tuple(map(self.of, shape.shapes))
            if shape.tag is not None:
                items = (Literal[shape.tag], *items)
            return _generic(tuple, items)
        built = build({**self._description, "root": shape.name})
        fields: list[tuple[str, Any, Any]] = []
        for index, (part, info) in enumerate(zip(shape.shapes, msgspec.structs.fields(built), strict=True)):
            annotation = self.of(part)
            if info.default is UNSET:
                default: Any = UNSET
            elif info.required:
                default = NODEFAULT
            else:
                value = info.default_factory() if info.default is NODEFAULT else info.default
                decoder: Any = msgspec.msgpack.Decoder(annotation)
                default = msgspec.field(
                    default_factory=partial(decoder.decode, msgspec.msgpack.encode(value))
                )
            fields.append((field_name(index), annotation, default))
        return msgspec.defstruct(
            "Payload",
            fields,
            kw_only=True,
            rename={field_name(index): key for index, key in enumerate(shape.keys)},
            tag=shape.tag,
            tag_field=shape.tag_field,
        )


def _generic(generic: Any, arguments: Any) -> Any:
    return generic[arguments]


def _limited(kind: Any, size: int | None, most: int | None) -> Any:
    if size is None and most is None:
        return kind
    return Annotated[kind, Meta(min_length=size, max_length=most or size)]

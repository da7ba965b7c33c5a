"""`make api`: docs/protocol-fields.md, made from the classes of the control messages and their records."""

from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args

import msgspec
from msgspec import inspect

from bus import names
from bus.qos import MAX_DEPTH, QoSProfile
from bus.wire import messages, records

PAGE = Path(__file__).parents[1] / "docs" / "protocol-fields.md"
HEAD = """\
# The fields of the protocol

This page has every field of every control message with its type, its bounds and its default. It is made from
the message classes of busd by `make api`. [protocol.md](protocol.md) describes what the messages and fields
mean.

A message is a MessagePack map: the key `m` with the tag, and the fields by their names, in any order.

- A field with a default may be absent, and then it has that default. A sender leaves it out then.
- A field without a default (*required*) is always there. A message without it is an error.
- A value of another type, or out of its bounds, is an error. A receiver ignores fields that it does not know.

A value may have any form of its type, long or short: a receiver accepts all of them.

| type | in MessagePack |
|---|---|
| integer | an integer; never a float |
| number | a float of 32 or 64 bits, or an integer. busd sends floats of 64 bits |
| boolean | true or false |
| text | str, in UTF-8. Bounds count characters |
| bytes | bin. Bounds count bytes |
| list of T | array |
| pair | array of two |
| map of K to V | map. Bounds count its entries |
| the name of a record | a map, with the fields by their names as in a message, but without `m` |
| null | nil |

If no bounds are given, they depend on the state of busd (an id is that of an existing endpoint), or on its
[configuration](configuration.md). An integer has at most 64 bits.
"""
_PARTS = "a `/` before each part; a part is like a node's name"
_TOPIC = f"{_PARTS}. At most {names.MAX_TOPIC_NAME_LENGTH} characters"
GROUPS = "Both ways", "From a client", "From busd", "Records"
BY_HAND = {
    (
        QoSProfile,
        "depth",
    ): f"1 to 2^{(MAX_DEPTH + 1).bit_length() - 1} - 1; with `keep_all` from 0, and ignored",
    (QoSProfile, "deadline"): "above 0, in seconds",
    (QoSProfile, "lifespan"): "above 0, in seconds",
    (QoSProfile, "liveliness_lease_duration"): "above 0, in seconds",
    (
        messages.CreateNode,
        "name",
    ): "letters `A` to `Z` and `a` to `z`, digits and `_`; the first is no digit. 1 to "
    f"{names.MAX_NODE_NAME_LENGTH} characters",
    (messages.CreateNode, "namespace"): f"`/`, or {_PARTS}. At most {names.MAX_NAMESPACE_LENGTH} characters",
    (messages.CreatePublisher, "topic"): _TOPIC,
    (messages.CreateSubscription, "topic"): _TOPIC,
    (messages.CreatePublisher, "gid"): "16 bytes",
    (messages.CreateSubscription, "gid"): "16 bytes",
    (messages.Matched, "gid"): "16 bytes",
    (records.EndpointRecord, "gid"): "16 bytes",
}
"""Bounds that other code than the decoder keeps."""


def groups() -> dict[str, list[type[msgspec.Struct]]]:
    """All classes, by GROUPS."""
    client, broker = get_args(messages.FromClient), get_args(messages.FromBroker)
    inside = [
        value
        for value in vars(records).values()
        if isinstance(value, type)
        and issubclass(value, msgspec.Struct)
        and value.__module__ == records.__name__
    ]
    found = (
        [one for one in client if one in broker],
        [one for one in client if one not in broker],
        [one for one in broker if one not in client],
        [*inside, QoSProfile],
    )
    return dict(zip(GROUPS, found, strict=True))


def page() -> str:
    return "\n\n".join([HEAD.rstrip("\n"), *(part for name in GROUPS for part in _group(name))]) + "\n"


def _group(name: str) -> Iterator[str]:
    yield f"## {name}"
    for cls in groups()[name]:
        tag = cls.__struct_config__.tag
        yield f"### {cls.__name__}" + (f" (`{tag}`)" if tag else "")
        if not cls.__struct_fields__:
            yield "It has no fields."
            continue
        yield "\n".join(["| field | type | bounds | default |", "|---|---|---|---|", *_rows(cls)])


def _rows(cls: type[msgspec.Struct]) -> Iterator[str]:
    described = inspect.type_info(cls)
    assert isinstance(described, inspect.StructType)
    for one in described.fields:
        kind, bounds = _kind(one.type), BY_HAND.get((cls, one.name)) or _bounds(one.type)
        yield f"| `{one.encode_name}` | {kind} | {bounds} | {default_of(one)} |"


def default_of(one: inspect.Field) -> str:
    """The default as on the page."""
    if one.required:
        return "*required*"
    return _value(one.default_factory() if one.default is msgspec.NODEFAULT else one.default)


def _value(value: Any) -> str:
    match value:
        case None:
            return "null"
        case Enum():
            return f"`{value.value}`"
        case bool():
            return str(value).lower()
        case str():
            return f"`{value}`" if value else "empty"
        case bytes():
            return f"the byte `{value.hex()}`" if value else "empty"
        case tuple() | dict():
            assert not value
            return "empty"
        case msgspec.Struct():
            assert value == type(value)()
            return "all its defaults"
    return f"{value:g}"


def _kind(type_: inspect.Type) -> str:
    match type_:
        case inspect.IntType():
            return "integer"
        case inspect.FloatType():
            return "number"
        case inspect.BoolType():
            return "boolean"
        case inspect.StrType() | inspect.EnumType() | inspect.LiteralType():
            return "text"
        case inspect.BytesType():
            return "bytes"
        case inspect.NoneType():
            return "null"
        case inspect.TupleType():
            assert len(type_.item_types) == 2
            return "pair of " + " and ".join(map(_kind, type_.item_types))
        case inspect.VarTupleType():
            return f"list of {_kind(type_.item_type)}"
        case inspect.DictType():
            return f"map of {_kind(type_.key_type)} to {_kind(type_.value_type)}"
        case inspect.StructType():
            return type_.cls.__name__
        case inspect.UnionType():
            return " or ".join(map(_kind, type_.types))
    raise TypeError(type_)


def _bounds(type_: inspect.Type) -> str:
    match type_:
        case inspect.IntType() | inspect.FloatType():
            return _range(type_.ge, type_.le)
        case inspect.StrType():
            return _range(type_.min_length, type_.max_length, " characters")
        case inspect.BytesType():
            return _range(type_.min_length, type_.max_length, " bytes")
        case inspect.EnumType():
            return ", ".join(f"`{member.value}`" for member in type_.cls)
        case inspect.LiteralType():
            return ", ".join(f"`{value}`" if value else "empty" for value in type_.values)
        case inspect.VarTupleType():
            return _of_items(_range(type_.min_length, type_.max_length), each=type_.item_type)
        case inspect.DictType():
            size = _range(type_.min_length, type_.max_length)
            return _of_items(size, key=type_.key_type, value=type_.value_type)
        case inspect.TupleType():
            return " and ".join(map(_bounds, type_.item_types))
        case inspect.UnionType():
            return "; ".join(filter(None, map(_bounds, type_.types)))
    return ""


def _of_items(size: str, **parts: inspect.Type) -> str:
    found = [f"{name} {bounds}" for name, type_ in parts.items() if (bounds := _bounds(type_))]
    return "; ".join([f"{size} entries"] * bool(size) + found)


def _range(least: float | None, most: float | None, unit: str = "") -> str:
    if least is None and most is None:
        return ""
    if least is None:
        return f"at most {_number(most)}{unit}"
    return f"{_number(least)} to {_number(most)}{unit}"


def _number(value: float | None) -> str:
    assert value is not None
    if isinstance(value, float):
        return f"{value:.0e}".replace("e+0", "e").replace("0e0", "0") if value else "0"
    size = abs(value)
    sign = "-" if value < 0 else ""
    if size < 1 << 16:
        return f"{value}"
    if size & (size + 1) == 0:
        power = f"2^{size.bit_length()} - 1"
        return f"{sign}({power})" if sign else power
    return f"{sign}2^{size.bit_length() - 1}"


if __name__ == "__main__":
    PAGE.write_text(page())
    print(f"written: {PAGE}")

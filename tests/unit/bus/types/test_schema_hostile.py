"""`build` with an enemy's schema: it makes a class or raises ConfigurationError, and does nothing else."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus.types.schema import MAX_DEPTH, MAX_ELEMENTS, Node, Schema, build, describe, type_name
from rows import for_each


def one_field(type_: object, **others: object) -> Schema:
    return schema_of([{"name": "x", "type": type_, **others}])


def schema_of(fields: object, **others: object) -> Schema:
    return {"root": "a/msg/A", "types": {"a/msg/A": {"fields": fields, **others}}}


def chain(length: int) -> Schema:
    types = {
        f"a/msg/T{i}": {"fields": [{"name": "x", "type": f"a/msg/T{i + 1}"}] if i + 1 < length else []}
        for i in range(length)
    }
    return {"root": "a/msg/T0", "types": types}


def doubling(levels: int) -> Schema:
    """Few types, but a default instance with 10 ** levels parts."""
    types: dict[str, Any] = {}
    for i in range(levels):
        inner = f"a/msg/T{i + 1}" if i + 1 < levels else "int8"
        types[f"a/msg/T{i}"] = {"fields": [{"name": f"x{n}", "type": inner} for n in range(10)]}
    return {"root": "a/msg/T0", "types": types}


def nested(depth: int) -> Node:
    node: Node = "int8"
    for _ in range(depth):
        node = ["list", node]
    return node


itself: list[Any] = ["list"]
itself.append(itself)

HOSTILE: dict[str, Any] = {
    "nothing": None,
    "a number": 5,
    "a text": "std_msgs/msg/String",
    "a list": [],
    "empty": {},
    "no types": {"root": "a/msg/A"},
    "no such root": {"root": "a/msg/A", "types": {}},
    "types in a list": {"root": "a/msg/A", "types": []},
    "fields missing": {"root": "a/msg/A", "types": {"a/msg/A": {}}},
    "fields no list": schema_of({"x": "int8"}),
    "a root of two parts": {"root": "a/A", "types": {"a/A": {"fields": []}}},
    "a root with a line break": {"root": "a/msg/A\n", "types": {"a/msg/A\n": {"fields": []}}},
    "a long root": {"root": "a/msg/" + "A" * 300, "types": {"a/msg/" + "A" * 300: {"fields": []}}},
    "an array flag that is none": schema_of([], array="yes"),
    "a tag that is none": schema_of([], tag=[]),
    "a huge tag": schema_of([], tag=2**80),
    "a tag field that is a field": schema_of([{"name": "x", "type": "int8"}], tag="t", tag_field="x"),
    "a field without a type": schema_of([{"name": "x"}]),
    "two fields of one name": schema_of([{"name": "x", "type": "int8"}, {"name": "x", "type": "string"}]),
    "two fields of one key": schema_of(
        [{"name": "x", "type": "int8", "key": "k"}, {"name": "k", "type": "int8"}]
    ),
    "too many fields": schema_of([{"name": f"x{i}", "type": "int8"} for i in range(2000)]),
    "too many types": chain(300),
    "too deep a chain of types": chain(MAX_DEPTH + 2),
    "too large a default": doubling(7),
    "too deep a type": one_field(nested(MAX_DEPTH + 1)),
    "far too deep a type": one_field(nested(50_000)),
    "a type that is its own part": one_field(itself),
    "too wide a type": one_field(["tuple", *["int8"] * 30_000]),
    "too many literals": one_field(
        ["union", *(["literal", *range(5000)] for _ in range(20)), "string", "bool"]
    ),
    "a huge fixed list": one_field(["list", "int8", MAX_ELEMENTS, MAX_ELEMENTS]),
    "huge fixed lists in each other": one_field(["list", ["list", "int8", 5000, 5000], 5000, 5000]),
    "huge fixed bytes": one_field(["bytes", 2**40, 2**40]),
    "an absurd length": one_field(["list", "int8", 0, 2**90]),
    "a negative length": one_field(["list", "int8", -1, 4]),
    "a length backwards": one_field(["list", "int8", 4, 1]),
    "a length that is true": one_field(["list", "int8", True, True]),
    "a length that is text": one_field(["bytes", "1", "2"]),
    "an unknown type": one_field("float128"),
    "an unknown kind": one_field(["matrix", "int8"]),
    "no kind": one_field([]),
    "a kind that is a list": one_field([["list"], "int8"]),
    "a type that is a number": one_field(["list", 5]),
    "a type that is nothing": one_field(["list", None]),
    "a type that is a dict": one_field({"list": "int8"}),
    "a list without an item": one_field(["list"]),
    "a union of nothing": one_field(["union"]),
    "a union that msgspec refuses": one_field(["union", ["list", "int8"], ["tuple", "int8"]]),
    "a literal of nothing": one_field(["literal"]),
    "a literal of lists": one_field(["literal", []]),
    "a literal of floats": one_field(["literal", 1.5]),
    "a literal of truth": one_field(["literal", True]),
    "a huge literal": one_field(["literal", 2**80]),
    "a dict with lists for keys": one_field(["dict", ["list", "int8"], "int8"]),
    "a dict with messages for keys": one_field(["dict", "a/msg/A", "int8"]),
    "a dict with no keys": one_field(["dict", [], "int8"]),
    "a dict with a number for keys": one_field(["dict", 5, "int8"]),
    "a message that is not there": one_field("a/msg/B"),
    "a message in itself": one_field("a/msg/A"),
    "a message in a list of itself": one_field(["list", "a/msg/A"]),
    "a default of another type": one_field("int8", default="text"),
    "a default out of range": one_field("int8", default=300),
    "a default with a lone surrogate": one_field("string", default="\ud800"),
    "a huge default": one_field("int", default=2**80),
    "a default that is no data": one_field("any", default=object()),
    # These types make msgspec crash the process.
    "a tuple beside a small integer": one_field(["union", ["tuple", "int"], "int8"]),
    "a tuple beside it, deeper": one_field(["union", ["union", ["tuple", "int"]], ["union", "none", "byte"]]),
    **{
        f"a field called {name!r:.20}": schema_of([{"name": name, "type": "int8"}])
        for name in (
            *(
                "",
                " ",
                "1",
                "a b",
                "a.b",
                "a-b",
                "class",
                "None",
                "import",
                "__class__",
                "__init__",
                "__type_name__",
            ),
            *(
                "__struct_fields__",
                "x: __import__('os')",
                "x\n",
                "a" * 300,
                "x=1",
                "lambda",
                "\u0660",
                "\x00",
            ),
        )
    },
}


@for_each("schema", HOSTILE.values())
def test_a_hostile_schema_is_refused(schema: Any) -> None:
    with pytest.raises(ConfigurationError):
        build(schema)


def test_what_is_large_but_honest_is_accepted() -> None:
    assert build(chain(MAX_DEPTH // 2))()
    assert build(doubling(5))()
    image: Any = build(one_field(["bytes", 1_000_000, 1_000_000]))()
    assert len(image.x) == 1_000_000


def test_what_a_later_version_adds_is_ignored() -> None:
    schema = schema_of([{"name": "x", "type": "int8", "unit": "m"}], doc="a type")
    assert build({**schema, "version": 2})(x=1)


def test_two_schemas_of_one_name_stay_apart() -> None:
    first, second = build(one_field("int8")), build(one_field("string"))
    assert first is not second
    assert (first(x=1), second(x="a")) == (first(x=1), second(x="a"))


NODES = st.sampled_from(["int8", "string", "any", "list", "union", "literal", "bytes", "tuple", "unset"])
# One of each kind, written by hand so that the test can damage each part.
ORIGINAL: Schema = {
    "root": "a/msg/A",
    "types": {
        "a/msg/A": {
            "tag": "t",
            "tag_field": "kind",
            "fields": [
                {"name": "a", "type": ["list", "float64", 3, 3], "default": [1.0, 2.0, 3.0]},
                {"name": "b", "type": ["union", "b/msg/B", "none", "unset"]},
                {"name": "c", "type": ["dict", "string", ["tuple", "int", "uint8"]], "required": True},
                {"name": "d", "type": ["literal", "x", 3], "key": "dee"},
                {"name": "e", "type": ["bytes", 1, 4], "default": b"ab"},
            ],
        },
        "b/msg/B": {"array": True, "fields": [{"name": "x", "type": "int8", "default": 4}]},
    },
}
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=5)
    | NODES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)


def changed(value: Any, path: Sequence[int], other: object) -> Any:
    """`value` with the part at `path` replaced."""
    if not path or not isinstance(value, list | Mapping) or not value:
        return other
    index = path[0] % len(value)
    if isinstance(value, list):
        return [*value[:index], changed(value[index], path[1:], other), *value[index + 1 :]]
    key = list(value)[index]
    return {**value, key: changed(value[key], path[1:], other)}


@given(schema=plain)
def test_garbage_never_gets_further_than_an_error(schema: Any) -> None:
    with pytest.raises(ConfigurationError):
        build(schema)


@given(path=st.lists(st.integers(0, 40), min_size=1, max_size=8), other=plain)
def test_a_damaged_schema_makes_a_class_or_an_error(path: list[int], other: Any) -> None:
    try:
        cls = build(changed(ORIGINAL, path, other))
    except ConfigurationError:
        return
    assert describe(cls)["root"] == type_name(cls)

"""Descriptions of the difference between two types with one name."""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from bus.msg import Message, float32, float64, int32, uint8
from bus.msg.geometry_msgs import Point, Vector3
from bus.srv import make_service
from bus.types.diff import difference
from bus.types.schema import describe
from bus.types.service import service_support
from rows import for_each


def described(**fields: Any) -> bytes:
    return encoded(msgspec.defstruct("Wheel", [*fields.items()], bases=(Message,), kw_only=True))


def encoded(cls: type[Struct]) -> bytes:
    return msgspec.msgpack.encode(describe(cls))


def inner(annotation: Any) -> type[Struct]:
    return msgspec.defstruct("Inner", [("x", annotation)], bases=(Message,), kw_only=True)


@for_each(
    ("one", "other", "text"),
    [
        ({"a": int, "x": float64}, {"a": int, "x": float32}, "field 'x' is float64 at P and float32 at S"),
        ({"x": float, "y": str}, {"x": str, "y": int}, "field 'x' is float64 at P and string at S"),
        ({"x": list[int32]}, {"x": list[uint8]}, "field 'x' is int32[] at P and uint8[] at S"),
        ({"x": list[int32]}, {"x": int32}, "field 'x' is int32[] at P and int32 at S"),
        ({"x": bytes}, {"x": list[uint8]}, "field 'x' is bytes at P and uint8[] at S"),
        (
            {"x": Annotated[list[int32], Meta(min_length=3, max_length=3)]},
            {"x": Annotated[list[int32], Meta(max_length=4)]},
            "field 'x' is int32[3] at P and int32[<=4] at S",
        ),
        (
            {"x": Annotated[bytes, Meta(min_length=2)]},
            {"x": bytes},
            "field 'x' is bytes[>=2] at P and bytes at S",
        ),
        (
            {"x": Point},
            {"x": Vector3},
            "field 'x' is geometry_msgs/msg/Point at P and geometry_msgs/msg/Vector3 at S",
        ),
        ({"x": int | None}, {"x": int}, "field 'x' is int | none at P and int at S"),
        ({"x": Literal["a"]}, {"x": Literal["b"]}, "field 'x' is literal[a] at P and literal[b] at S"),
        (
            {"x": dict[str, int]},
            {"x": dict[str, str]},
            "field 'x' is dict[string, int] at P and dict[string, string] at S",
        ),
        ({"a": int, "b": int}, {"a": int}, "only P has a field 'b' (int)"),
        ({"a": int}, {"z": str, "a": int}, "only S has a field 'z' (string)"),
        ({"a": int, "b": int}, {"b": int, "a": int}, "number 1 of the fields is 'a' at P and 'b' at S"),
        ({"x": inner(int)}, {"x": inner(str)}, "field 'x.x' is int at P and string at S"),
        ({"x": list[inner(int)]}, {"x": list[inner(str)]}, "field 'x[].x' is int at P and string at S"),
        ({"x": inner(int) | None}, {"x": inner(str) | None}, "field 'x.x' is int at P and string at S"),
        (
            {"x": dict[str, inner(int)]},
            {"x": dict[str, inner(str)]},
            "field 'x.x' is int at P and string at S",
        ),
    ],
)
def test_the_first_field_that_differs(one: dict[str, Any], other: dict[str, Any], text: str) -> None:
    assert difference(described(**one), described(**other), ("P", "S")) == text


def test_defaults_do_not_count() -> None:
    class Wheel(Message):
        x: int = 3

    assert difference(encoded(Wheel), described(x=int)) is None


def test_how_it_is_sent() -> None:
    mapped = msgspec.defstruct("Wheel", [("x", int)])
    renamed = msgspec.defstruct("Wheel", [("x", int)], rename={"x": "ex"})
    listed = msgspec.defstruct("Wheel", [("x", int)], array_like=True)
    ends = "P", "S"
    assert difference(encoded(mapped), encoded(listed), ends) == (
        "the whole is a map at P and an array (array_like) at S"
    )
    assert difference(encoded(renamed), encoded(mapped), ends) == (
        "the name on the wire of field 'x' is 'ex' at P and 'x' at S"
    )


def test_a_service_is_told_without_its_envelope() -> None:
    def requests(request: Any, response: Any) -> bytes:
        parts = (msgspec.defstruct("Part", [("a", kind)], bases=(Message,)) for kind in (request, response))
        return msgspec.msgpack.encode(service_support(make_service("demo/srv/Do", *parts)).requests.schema)  # type: ignore[arg-type]

    first = requests(int, int)
    assert difference(first, requests(str, int)) == (
        "field 'a' is int at the client and string at the server"
    )
    assert difference(first, requests(int, str)) == "the definitions of the response differ"


@for_each(
    "broken",
    [
        b"",
        b"\xc0",
        b"\xff" * 9,
        msgspec.msgpack.encode({"root": "a/msg/A", "types": {}}),
        msgspec.msgpack.encode(
            {
                "root": "a/msg/A",
                "types": {"a/msg/A": {"fields": [{"name": "x", "type": "b/msg/B"}], "array": True}},
            }
        ),
    ],
)
def test_a_broken_description_is_no_difference(broken: bytes) -> None:
    assert difference(described(), broken) in (None, "only the subscription has a field 'x' (b/msg/B)")
    assert difference(broken, broken) is None


def test_types_within_themselves_end() -> None:
    fields = [{"name": "x", "type": "a/msg/A"}, {"name": "y", "type": "int"}]
    one = {"root": "a/msg/A", "types": {"a/msg/A": {"fields": fields}}}
    other = {"root": "a/msg/A", "types": {"a/msg/A": {"fields": [fields[0], fields[1] | {"type": "any"}]}}}
    assert difference(*map(msgspec.msgpack.encode, (one, other)), ("P", "S")) == (  # type: ignore[arg-type, call-arg]
        "field 'y' is int at P and any at S"
    )


def test_words_of_others_are_cut_and_shown_plainly() -> None:
    name = "\x1b[31m" + "x" * 230
    data = msgspec.msgpack.encode(
        {"root": "a/msg/A", "types": {"a/msg/A": {"fields": [{"name": name, "type": "int"}]}}}
    )
    found = difference(data, described())
    assert found is not None
    assert "\x1b" not in found
    assert len(found) < 400


def test_a_tag_of_others_is_cut_too() -> None:
    types = {"a/msg/A": {"fields": [], "tag": "x" * 100_000, "tag_field": "y"}}
    found = difference(described(), msgspec.msgpack.encode({"root": "a/msg/A", "types": types}))
    assert found is not None
    assert len(found) <= 1000

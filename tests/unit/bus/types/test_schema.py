"""Schemas: descriptions of classes by `describe`, and classes that `build` makes of them, even of an enemy's
schema.
"""

import datetime
import enum
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Generic, Literal, NamedTuple, TypedDict, TypeVar

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import UNSET, Meta, Struct, UnsetType, field

from bus.errors import ConfigurationError, MessageTypeError
from bus.msg import Message, byte, float32, uint8
from bus.msg.geometry_msgs import Point, Pose
from bus.types.schema import Node, Schema, build, describe, type_name
from rows import for_each

T = TypeVar("T")


class Colour(enum.Enum):
    RED = "red"
    BLUE = "blue"


class Level(enum.IntEnum):
    LOW = 1
    HIGH = 2


class Access(enum.IntFlag):
    READ = 1
    WRITE = 2


@dataclass
class Plain:
    x: int = 0


class Pair(NamedTuple):
    first: int
    second: str


class Options(TypedDict):
    verbose: bool


class Box(Struct, Generic[T]):
    content: T


class Cat(Struct, tag="cat"):
    lives: int = 9


class Dog(Struct, tag="dog"):
    name: str = ""


class Inner(Struct, rename="camel", frozen=True):
    first_name: str = "x"
    age: int = 0


class Tree(Struct):
    label: str = ""
    children: list["Tree"] = field(default_factory=list)
    parent: "Tree | None" = None


class Zoo(Struct, kw_only=True, tag_field="kind", tag=7, omit_defaults=True):
    """One field of each kind that msgspec can encode."""

    __type_name__: ClassVar[str] = "demo/msg/Zoo"

    flag: bool = True
    count: int
    small: uint8 = 3
    ratio: float32 = 0.5
    text: str = "hi"
    octet: byte = b"\x01"
    blob: bytes = b"\x00\xff"
    key: Annotated[bytes, Meta(min_length=2, max_length=2)] = b"ab"
    numbers: list[float] = field(default_factory=list)
    corners: Annotated[list[Point], Meta(min_length=2, max_length=2)]
    names: set[str] = field(default_factory=set)
    path: tuple[int, ...] = ()
    pair: tuple[int, str] = (1, "a")
    named: Pair = Pair(1, "b")
    table: dict[str, list[int]] = field(default_factory=dict)
    by_number: dict[int, Inner] = field(default_factory=dict)
    maybe: int | None = None
    left_out: int | UnsetType = UNSET
    both: int | UnsetType | None = UNSET
    colour: Colour = Colour.RED
    level: Level = Level.HIGH
    access: Access = Access.READ
    word: Literal["a", "b", 3] = "a"
    pose: Pose = field(default_factory=Pose)
    inner: Inner = Inner(first_name="y", age=4)
    pet: Cat | Dog = field(default_factory=Dog)
    plain: Plain = field(default_factory=Plain)
    options: Options | None = None
    when: datetime.datetime | None = None
    anything: Any = None
    box: Box[int] | None = None
    tree: Tree = field(default_factory=Tree)


def zoo(**values: Any) -> Zoo:
    return Zoo(count=1, corners=[Point(x=1.0), Point(y=2.0)], **values)


def nodes(cls: type[Struct]) -> dict[str, Node]:
    schema = describe(cls)
    return {field["name"]: field["type"] for field in schema["types"][schema["root"]]["fields"]}


def test_each_type_is_described_by_what_is_on_the_wire() -> None:
    assert nodes(Zoo) == {
        "flag": "bool",
        "count": "int",
        "small": "uint8",
        "ratio": "float32",
        "text": "string",
        "octet": "byte",
        "blob": "uint8[]",
        "key": ["bytes", 2, 2],
        "numbers": ["list", "float64"],
        "corners": ["list", "geometry_msgs/msg/Point", 2, 2],
        "names": ["list", "string"],
        "path": ["list", "int"],
        "pair": ["tuple", "int", "string"],
        "named": ["tuple", "int", "string"],
        "table": ["dict", "string", ["list", "int"]],
        "by_number": ["dict", "int", "local/msg/Inner"],
        "maybe": ["union", "int", "none"],
        "left_out": ["union", "int", "unset"],
        "both": ["union", "int", "none", "unset"],
        "colour": ["literal", "blue", "red"],
        "level": ["literal", 1, 2],
        "access": "int",
        "word": ["literal", "a", "b", 3],
        "pose": "geometry_msgs/msg/Pose",
        "inner": "local/msg/Inner",
        "pet": ["union", "local/msg/Cat", "local/msg/Dog"],
        "plain": ["dict", "string", "any"],
        "options": ["union", ["dict", "string", "any"], "none"],
        "when": "any",
        "anything": "any",
        "box": "any",
        "tree": "local/msg/Tree",
    }


def test_a_type_says_how_it_is_encoded() -> None:
    types = describe(Zoo)["types"]
    assert (types["demo/msg/Zoo"]["tag"], types["demo/msg/Zoo"]["tag_field"]) == (7, "kind")
    assert types["geometry_msgs/msg/Pose"]["array"] is True
    assert "array" not in types["local/msg/Inner"]
    assert types["local/msg/Inner"]["fields"][0] == {
        "name": "first_name",
        "type": "string",
        "key": "firstName",
        "default": "x",
    }


def test_defaults_are_told_where_they_are_plain_and_not_zero() -> None:
    class Defaults(Struct):
        required: int
        zero: int = 0
        seven: int = 7
        empty: list[int] = []
        fixed: Annotated[list[float], Meta(min_length=2, max_length=2)] = field(
            default_factory=partial(list, (0.0, 0.0))
        )
        ones: list[int] = field(default_factory=partial(list, (1, 1)))
        unknown: int = field(default_factory=lambda: 4)
        large: str = "x" * 5000

    fields = {
        described["name"]: described
        for described in describe(Defaults)["types"]["local/msg/Defaults"]["fields"]
    }
    assert fields["seven"]["default"] == 7
    assert fields["ones"]["default"] == [1, 1]
    assert [name for name in fields if "default" in fields[name]] == ["seven", "ones"]
    assert [name for name in fields if fields[name].get("required")] == ["required", "unknown", "large"]


def test_a_type_inside_itself_is_anything() -> None:
    assert nodes(Tree) == {"label": "string", "children": ["list", "any"], "parent": "any"}
    tree = Tree(label="root", children=[Tree(label="leaf")])
    decoded: Any = msgspec.msgpack.decode(msgspec.msgpack.encode(tree), type=build(describe(Tree)))
    assert decoded.label == "root"
    assert decoded.children[0]["label"] == "leaf"


def test_two_classes_of_one_name_are_refused() -> None:
    def other() -> type[Struct]:
        class Inner(Struct):
            x: int = 0

        return Inner

    both = msgspec.defstruct("Both", [("first", Inner), ("second", other())])
    with pytest.raises(ConfigurationError, match=r"are both local/msg/Inner; set __type_name__"):
        describe(both)


@for_each("wrong", [int, Plain, "text", Cat(), Box[int], None])
def test_only_message_classes_are_described(wrong: Any) -> None:
    with pytest.raises(MessageTypeError, match="is no message class"):
        describe(wrong)


def test_a_class_that_msgspec_refuses_is_named() -> None:
    class Torn(Struct):
        x: "NotThere"  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(MessageTypeError, match="Torn"):
        describe(Torn)


@for_each("name", ["String", "std_msgs/String", "std_msgs/msg/", "a/msg/b/c", "a/msg/1", "a/b/C", 5, ""])
def test_a_type_name_has_three_parts(name: object) -> None:
    cls = msgspec.defstruct("Foo", [], namespace={"__type_name__": name})
    with pytest.raises(ConfigurationError, match="must have three parts"):
        type_name(cls)


def test_a_type_name_is_not_inherited() -> None:
    class Child(Zoo):
        pass

    assert type_name(Zoo) == "demo/msg/Zoo"
    assert type_name(Child) == "local/msg/Child"


@for_each("cls", [Zoo, Tree, Inner, Cat, Pose])
def test_a_class_made_from_a_schema_has_that_schema(cls: type[Struct]) -> None:
    schema = msgspec.msgpack.decode(msgspec.msgpack.encode(describe(cls)))
    assert describe(build(schema)) == schema == describe(cls)


def test_a_class_made_from_a_schema_reads_the_same_bytes() -> None:
    original = zoo(
        table={"a": [1]}, by_number={2: Inner()}, pet=Cat(lives=3), maybe=4, left_out=5, names={"n"}
    )
    data = msgspec.msgpack.encode(original)
    foreign = build(describe(Zoo))
    message: Any = msgspec.msgpack.decode(data, type=foreign)
    assert foreign.__struct_fields__ == Zoo.__struct_fields__
    assert type_name(foreign) == "demo/msg/Zoo"
    assert (message.count, message.small, message.text, message.colour) == (1, 3, "hi", "red")
    assert message.corners[1].y == 2.0
    assert message.inner.first_name == "y"
    assert (message.pair, message.blob, message.pet.lives) == ((1, "a"), b"\x00\xff", 3)
    assert message.both is UNSET
    # This end knows the defaults that the sender leaves out.
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(message), type=Zoo) == original


def test_containers_in_defaults_are_not_shared() -> None:
    fields = [{"name": "x", "type": "any", "default": [[1]]}, {"name": "y", "type": ["list", "any"]}]
    foreign = build({"root": "a/msg/A", "types": {"a/msg/A": {"fields": fields}}})
    first: Any = foreign()
    first.x[0].append(2)
    first.y.append(3)
    second: Any = foreign()
    assert (second.x, second.y) == ([[1]], [])


def test_it_prints_as_a_ros_message() -> None:
    assert repr(build(describe(Inner))()) == "local.msg.Inner(first_name='x', age=0)"
    assert repr(build(describe(Point))(x=1.5)) == "geometry_msgs.msg.Point(x=1.5, y=0.0, z=0.0)"


names = st.from_regex(r"[a-z][a-z0-9_]{0,5}", fullmatch=True).filter(lambda name: not name.startswith("__"))
INTEGERS = ["int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "char", "int"]
BYTES = ["byte", "uint8[]", "byte[]", "bytes"]
OTHERS = ["bool", "float32", "float64", "string", "any", "none", "b/msg/B"]
leaves = st.sampled_from([*INTEGERS, *BYTES[:-1], *OTHERS])
lengths = st.integers(0, 3)


def wider(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.one_of(
        st.builds(lambda item: ["list", item], inner),
        st.builds(lambda item, least, more: ["list", item, least, least + more], inner, lengths, lengths),
        st.builds(lambda items: ["tuple", *items], st.lists(inner, max_size=3)),
        st.builds(lambda key, value: ["dict", key, value], st.sampled_from(["string", "int"]), inner),
        st.builds(
            lambda items: ["union", *items],
            st.lists(
                inner.filter(lambda node: node[0] != "union"), min_size=1, max_size=3, unique_by=wire_kind
            ),
        ),
        st.builds(
            lambda values: ["literal", *values], st.lists(st.integers() | st.text(), min_size=1, max_size=3)
        ),
        st.builds(lambda least: ["bytes", least, least + 1], lengths),
    )


def wire_kind(node: Node) -> str:
    """The kind of a type on the wire. msgspec allows each kind once in a union."""
    name = node if isinstance(node, str) else node[0]
    kinds = dict.fromkeys([*INTEGERS, "literal"], "int") | dict.fromkeys(BYTES, "bytes")
    return kinds.get(name, "float" if name.startswith("float") else name)


types = st.recursive(leaves, wider, max_leaves=6)


@given(
    fields=st.dictionaries(names, types, max_size=4),
    array=st.booleans(),
    tag=st.none() | st.integers(-5, 5) | names,
)
def test_any_schema_makes_a_class_of_that_schema(
    fields: dict[str, Node], array: bool, tag: str | int | None
) -> None:
    schema: Schema = {
        "root": "a/msg/A",
        "types": {
            "a/msg/A": {
                "fields": [{"name": name, "type": node} for name, node in fields.items()],
                "array": array,
                "tag": tag,
            },
            "b/msg/B": {"fields": [{"name": "x", "type": "float64", "default": 1.5}]},
        },
    }
    try:
        cls = build(schema)
    except ConfigurationError:
        assume(False)  # msgspec does not have every union or literal
    described = describe(cls)
    assert describe(build(described)) == described
    message = cls()
    data = msgspec.msgpack.encode(message)
    assert msgspec.msgpack.encode(msgspec.msgpack.decode(data, type=build(described))) == data


def test_a_message_class_may_have_any_base() -> None:
    class Mixed(Message, kw_only=True, array_like=False):
        x: int = 0

    assert "array" not in describe(Mixed)["types"]["local/msg/Mixed"]
    decoded: Any = msgspec.msgpack.decode(msgspec.msgpack.encode(Mixed(x=2)), type=build(describe(Mixed)))
    assert decoded.x == 2

"""Types that are too large or too deep for one generated function."""

import random
from typing import Any

import msgspec

import bus
from bus_ros.cdr import CdrError, Codec, codec_of
from payloads import Filler
from rows import for_each


def codec(types: dict[str, list[Any]]) -> tuple[dict[str, Any], Codec]:
    described = {
        name: {"array": True, "fields": [{"name": f"f{at}", "type": node} for at, node in enumerate(nodes)]}
        for name, nodes in types.items()
    }
    description = {"root": next(iter(types)), "types": described}
    return description, codec_of(bus.MessageSchema("", "", msgspec.msgpack.encode(description)))


def nested(node: Any, depth: int) -> Any:
    return node if not depth else ["list", nested(node, depth - 1)]


DEEP = nested("a/msg/Large", 7)
LARGE = ["string", "uint8", *["float64"] * 40]
OFTEN: list[Any] = [
    "uint8",
    "a/msg/Large",
    "a/msg/Large",
    ["list", "a/msg/Large"],
    ["dict", "int", "a/msg/Large"],
]


@for_each(
    "nodes",
    [
        OFTEN,
        [["union", "a/msg/Large", "none"], "bool", ["list", "a/msg/Large", 2, 2]],
        ["int8", DEEP, "float64"],
        [["list", ["dict", "string", ["list", ["dict", "int", nested("a/msg/Large", 3)]]]]],
    ],
)
def test_what_is_large_or_deep_comes_back(nodes: list[Any]) -> None:
    description, made = codec({"a/msg/A": nodes, "a/msg/Large": LARGE})
    for seed in range(3):
        payload = msgspec.msgpack.encode(Filler(description, random.Random(seed)).value("a/msg/A"))
        sent = b"".join(made.encode(payload))
        assert made.decode(sent) == payload


def test_few_types_that_make_a_message_of_many_values_make_little_source() -> None:
    types = {f"a/msg/T{level}": [f"a/msg/T{level + 1}"] * 10 for level in range(4)} | {
        "a/msg/T4": ["uint8"] * 10
    }
    description, made = codec(types)
    payload = msgspec.msgpack.encode(Filler(description, random.Random(0)).value("a/msg/T0"))
    (sent,) = made.encode(payload)
    assert len(sent) == 4 + 10**5
    assert made.decode(sent) == payload
    assert len(made._encode_short.__globals__) < 500  # type: ignore[attr-defined]


def test_names_of_others_are_no_part_of_the_source() -> None:
    description, _ = codec({"a/msg/A": ["int8", "string"]})
    evil = ("'); raise SystemExit #", "{v1}'''", "') + exit() + ('", "}{")
    described = description["types"]["a/msg/A"]
    described |= {"array": False, "tag": evil[2], "tag_field": evil[3]}
    for field, key in zip(described["fields"], evil, strict=False):
        field["key"] = key
    made = codec_of(bus.MessageSchema("", "", msgspec.msgpack.encode(description)))
    message = {evil[3]: evil[2], evil[0]: 1, evil[1]: "x"}
    sent = made.encode(msgspec.msgpack.encode(message))[0]
    assert msgspec.msgpack.decode(made.decode(sent)) == message


def test_a_gap_in_an_array_is_null() -> None:
    _, made = codec({"a/msg/A": [["union", "int8", "unset"], "int8"]})
    payload = msgspec.msgpack.encode([None, 1])
    assert made.decode(made.encode(payload)[0]) == payload


def test_messages_of_too_many_fields_are_refused() -> None:
    _, made = codec({"a/msg/A": ["int8"] * 3})
    for values in ([], [1, 2], [1, 2, 3, 4], {"f0": 1}, 5):
        try:
            made.encode(msgspec.msgpack.encode(values))
        except CdrError as error:
            assert "a/msg/A" in str(error)
        else:
            raise AssertionError(values)

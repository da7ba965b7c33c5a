"""CDR of random types: encoded values come back, and for any bytes the only error is CdrError."""

import random
from typing import Any

import msgspec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bus
from bus.types.classes import message_class
from bus_ros.cdr import CdrError, Codec, codec_of, schema_of_definition
from bus_ros.cdr.encoder import encoder
from effort import examples
from payloads import Filler

WORLD = "demo/msg/World"
PRIMITIVES = (
    *(
        "bool",
        "byte",
        "char",
        "int8",
        "uint8",
        "int16",
        "uint16",
        "int32",
        "uint32",
        "int64",
        "uint64",
        "int",
    ),
    *("float32", "float64", "string", "uint8[]", "byte[]"),
)
single = st.one_of(
    st.sampled_from((*PRIMITIVES, "demo/msg/Part", "demo/msg/Named", "demo/msg/Empty")),
    st.builds(lambda most: ["string", most], st.integers(1, 9)),
    st.builds(lambda size: ["bytes", size, size], st.integers(1, 9)),
    st.builds(lambda most: ["bytes", 0, most, "byte"], st.integers(1, 9)),
    st.sampled_from((["literal", 1, 2], ["literal", "a", "b"], ["tuple", "int8", "string"], "any")),
)


KEYS = st.sampled_from(("string", "int", "bool", "float64", "byte", "uint8[]", ["literal", "a", "b"], "any"))


def around(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.one_of(
        st.builds(lambda item: ["list", item], inner),
        st.builds(lambda item, most: ["list", item, 0, most], inner, st.integers(1, 5)),
        st.builds(lambda item, size: ["list", item, size, size], inner, st.sampled_from((1, 2, 3, 70))),
        st.builds(lambda item: ["union", item, "none"], inner.filter(lambda item: "union" not in item)),
        st.builds(lambda key, item: ["dict", key, item], KEYS, inner),
    )


node = st.recursive(single, around, max_leaves=4)
fields = st.lists(node, max_size=8).map(
    lambda nodes: [{"name": f"f{number}", "type": one, "required": True} for number, one in enumerate(nodes)]
)


@st.composite
def descriptions(draw: st.DrawFn) -> dict[str, Any]:
    types = {
        WORLD: {"array": draw(st.booleans()), "fields": draw(fields)},
        "demo/msg/Part": {"array": True, "fields": [{"name": "x", "type": "float64"}]},
        "demo/msg/Named": {
            "array": False,
            "fields": [{"name": "name", "type": "string"}, {"name": "at", "type": "demo/msg/Part"}],
            "tag": "named",
            "tag_field": "kind",
        },
        "demo/msg/Empty": {"array": True, "fields": []},
    }
    return {"root": WORLD, "types": types}


def random_codec(description: dict[str, Any]) -> Codec:
    return codec_of(bus.MessageSchema(WORLD, "", msgspec.msgpack.encode(description)))


@settings(deadline=None, max_examples=examples(150), suppress_health_check=list(HealthCheck))
@given(descriptions(), st.integers(0, 2**32))
def test_what_was_encoded_comes_back(description: dict[str, Any], seed: int) -> None:
    codec = random_codec(description)
    message = Filler(description, random.Random(seed)).value(WORLD)
    payload = msgspec.msgpack.encode(message)
    parts = codec.encode(payload)
    assert b"".join(encoder(description, codec.shape, True)(payload)) == b"".join(parts)
    assert msgspec.msgpack.decode(codec.decode(b"".join(parts)), strict=False) == message
    parsed = schema_of_definition(codec.type_name, codec.definition)
    assert (parsed.type_name, parsed.type_hash) == (codec.type_name, codec.type_hash)
    # A process with only the definition has other shapes in MessagePack, but the same CDR bytes.
    others = codec_of(parsed)
    assert b"".join(others.encode(others.decode(b"".join(parts)))) == b"".join(parts)


@settings(deadline=None, max_examples=examples(100), suppress_health_check=list(HealthCheck))
@given(descriptions(), st.integers(0, 2**32), st.data())
def test_no_bytes_raise_anything_but_the_error_for_that(
    description: dict[str, Any], seed: int, data: st.DataObject
) -> None:
    codec = random_codec(description)
    payload = msgspec.msgpack.encode(Filler(description, random.Random(seed)).value(WORLD))
    cdr = b"".join(codec.encode(payload))
    for good, use in ((cdr, codec.decode), (payload, codec.encode)):
        at = data.draw(st.integers(0, len(good)))
        new = data.draw(st.one_of(st.binary(max_size=8), st.just(b"\xff\xff\xff\x7f")))
        for bad in (new, good[:at], good[:at] + new + good[at + len(new) :]):
            try:
                use(bad)
            except CdrError:
                pass


MARKER = codec_of(bus.MessageSchema.of(message_class("visualization_msgs/msg/Marker")))


@settings(deadline=None, max_examples=examples(300))
@given(st.sampled_from((0, 1, 6, 7, 8, 9)), st.binary(max_size=400))
def test_random_bytes_of_every_representation(kind: int, body: bytes) -> None:
    try:
        MARKER.decode(bytes((0, kind, 0, 0)) + body)
    except CdrError:
        pass

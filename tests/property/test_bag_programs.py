"""Programs against `bus_ros.cdr`, for random types and values: the same records, or none if Python refuses.

A program may refuse a pack that Python accepts, because the recorder then uses Python. It must not do so for
the payloads that publishers send.
"""

import random
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bus.schema import MessageSchema
from bus_bag.core import Program, program_of
from bus_bag.storage.chunk import ChunkBuilder
from bus_ros.cdr import CdrError, Codec, codec_of
from effort import examples
from packing import packed
from payloads import Filler

pytestmark = pytest.mark.skipif(Program is None, reason="BUS_NATIVE=no")

WORLD = "demo/msg/World"
_INTEGERS = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
single = st.one_of(
    st.sampled_from(("bool", "byte", "char", "int", *_INTEGERS, "float32", "float64", "string")),
    st.sampled_from(("uint8[]", "byte[]", "demo/msg/Part", "demo/msg/Deep", "demo/msg/Empty")),
    st.builds(lambda most: ["string", most], st.integers(1, 9)),
    st.builds(lambda size: ["bytes", size, size], st.integers(1, 9)),
    st.builds(lambda most: ["bytes", 0, most], st.integers(1, 9)),
)


def around(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.one_of(
        st.builds(lambda item: ["list", item], inner),
        st.builds(lambda item, most: ["list", item, 0, most], inner, st.integers(1, 5)),
        st.builds(lambda item, size: ["list", item, size, size], inner, st.sampled_from((1, 2, 3, 70))),
    )


node = st.recursive(single, around, max_leaves=4)


def described(*nodes: Any) -> dict[str, Any]:
    fields = [{"name": f"f{number}", "type": one} for number, one in enumerate(nodes)]
    types = {
        WORLD: {"array": True, "fields": fields},
        "demo/msg/Part": {"array": True, "fields": [{"name": "x", "type": "float64"}]},
        "demo/msg/Deep": {
            "array": True,
            "fields": [
                {"name": "part", "type": "demo/msg/Part"},
                {"name": "names", "type": ["list", "string"]},
            ],
        },
        "demo/msg/Empty": {"array": True, "fields": []},
    }
    return {"root": WORLD, "types": types}


def in_python(codec: Codec, payloads: list[bytes]) -> tuple[bytes, bytes] | None:
    """The records and the index by Python; None if it refuses a payload."""
    builder = ChunkBuilder()
    stamps = [(1000 + number, 77, number, 0, 0) for number in range(len(payloads))]
    try:
        builder.add_many(5, stamps, codec.encode_many(payloads))
    except CdrError:
        return None
    chunk = builder.close()
    assert chunk is not None
    return b"".join(chunk.pieces), chunk.index[5].tobytes()


def in_the_core(codec: Codec, payloads: list[bytes]) -> tuple[bytes, bytes] | None:
    program = program_of(codec.shape)
    assert program is not None
    pack = packed((number, 1000 + number, payload) for number, payload in enumerate(payloads))
    made = program.records(pack, 5, 77, 0)
    messages = program.messages((*payloads, memoryview(payloads[0])))
    assert (messages is None) == (made is None)
    assert messages is None or messages == codec.encode_many([*payloads, payloads[0]])
    return None if made is None else (bytes(made[0]), made[1])


@settings(deadline=None, max_examples=examples(150), suppress_health_check=list(HealthCheck))
@given(st.lists(node, max_size=8), st.integers(0, 2**32), st.data())
def test_the_same_records(nodes: list[Any], seed: int, data: st.DataObject) -> None:
    description = described(*nodes)
    codec = codec_of(MessageSchema(WORLD, "", msgspec.msgpack.encode(description)))
    chance = random.Random(seed)
    payloads = [msgspec.msgpack.encode(Filler(description, chance).value(WORLD)) for _ in range(3)]
    found = in_the_core(codec, payloads)
    assert found == in_python(codec, payloads) and found is not None
    # A hostile publisher's payloads: cut, longer, of other types, nested too deeply.
    good = payloads[0]
    at = data.draw(st.integers(0, len(good)))
    new = data.draw(
        st.one_of(
            st.binary(max_size=8),
            st.sampled_from(
                (b"\xdd\xff\xff\xff\xff", b"\x91" * 2000, b"\xdb\x7f\xff\xff\xff", b"\xc6\xff\xff\xff\xff")
            ),
            st.integers(-(2**63), 2**64 - 1).map(msgspec.msgpack.encode),
            st.floats().map(msgspec.msgpack.encode),
        )
    )
    for bad in (
        new,
        good[:at],
        good + new,
        good[:at] + new + good[at:],
        good[:at] + new + good[at + len(new) :],
    ):
        wrong = [payloads[1], bad, payloads[2]]
        refused, expected = in_the_core(codec, wrong), in_python(codec, wrong)
        assert refused in (None, expected), bad

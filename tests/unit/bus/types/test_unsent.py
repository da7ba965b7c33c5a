"""bus.types.unsent: few bytes never become many values, and a value sent in full is never refused."""

from typing import Any

import msgspec
import pytest

from bus.errors import ConfigurationError
from bus.types.schema import build, describe
from bus.types.support import TypeSupport, type_support
from bus.types.unsent import MOST_UNSENT
from rows import for_each

FIELDS = 1000
MANY = MOST_UNSENT // FIELDS

Wide: Any = msgspec.defstruct(
    "Wide", [(f"f{at}", int, 0) for at in range(FIELDS)], omit_defaults=True, tag="wide"
)
Flat: Any = msgspec.defstruct("Flat", [(f"f{at}", int, 0) for at in range(FIELDS)], array_like=True)


class Small(msgspec.Struct, tag="small"):
    text: str = ""


class Shelf(msgspec.Struct):
    places: list[Wide] = []


class Holder(msgspec.Struct):
    """Containers of all kinds."""

    items: list[Wide] = []
    table: dict[str, Wide] = {}
    pairs: list[tuple[int, Wide]] = []
    either: list[Wide | Small | None] = []
    shelf: Shelf | None = None
    shelves: list[Shelf] = []
    flat: list[Flat] = []
    numbers: list[int] = []
    anything: Any = None


class Renamed(msgspec.Struct, rename={"items": "x"}):
    items: list[Wide] = []


def foreign(cls: type[msgspec.Struct]) -> TypeSupport[Any]:
    """The type support in another process, which received only the description of the type."""
    return type_support(build(describe(cls)))


def bombs(count: int) -> dict[str, Any]:
    """For each field, a value that holds `count` wide structs."""
    return {
        "items": [{}] * count,
        "table": {str(at): {} for at in range(count)},
        "pairs": [[1, {}]] * count,
        "either": [{"type": "wide"}] * count,
        "shelf": {"places": [{}] * count},
        "shelves": [{"places": [{}]}] * count,
        "flat": [[]] * count,
    }


@for_each("field", [*bombs(0)])
def test_few_bytes_do_not_become_many_values(field: str) -> None:
    decode = foreign(Holder).decode
    value = bombs(MANY - 100)[field]
    if field in ("items", "shelf", "flat"):
        assert decode(msgspec.msgpack.encode({field: value})) is not None
    with pytest.raises(msgspec.ValidationError, match="more than 1,000,000 values are left out in it"):
        decode(msgspec.msgpack.encode({field: bombs(MANY + 100)[field]}))


def test_under_another_name_on_the_wire() -> None:
    with pytest.raises(msgspec.ValidationError, match="left out"):
        foreign(Renamed).decode(msgspec.msgpack.encode({"x": [{}] * (MANY + 100)}))


def test_memory_may_be_given_as_a_view() -> None:
    with pytest.raises(msgspec.ValidationError, match="left out"):
        foreign(Holder).decode(memoryview(msgspec.msgpack.encode({"items": [{}] * (MANY + 100)})))


def test_what_was_sent_whole_is_taken_however_long_it_is() -> None:
    whole = [1] * FIELDS
    honest: dict[str, list[Any]] = {
        "flat": [whole] * (2 * MANY),
        "items": [dict(zip(Wide.__struct_fields__, whole, strict=True), type="wide")] * 100,
        "either": [{"type": "small", "text": "x" * 10}] * (5 * MANY) + [None],
        "numbers": [0] * (2 * MOST_UNSENT),
        "anything": [{}] * (2 * MOST_UNSENT),
    }
    for field, value in honest.items():
        message = foreign(Holder).decode(msgspec.msgpack.encode({field: value}))
        assert len(getattr(message, field)) == len(value)


def test_what_does_not_decode_is_refused_for_its_own_reason() -> None:
    decode = foreign(Holder).decode
    with pytest.raises(msgspec.ValidationError, match="Expected `array`"):
        decode(msgspec.msgpack.encode({"items": "x" * 2_000_000}))
    with pytest.raises(msgspec.DecodeError, match="truncated"):
        decode(msgspec.msgpack.encode({"items": [{}] * 5000})[:-1])


def test_a_program_s_own_class_is_its_own_matter() -> None:
    message = type_support(Holder).decode(msgspec.msgpack.encode({"items": [{}] * (MANY + 100)}))
    assert len(message.items) == MANY + 100


def test_types_without_structs_in_containers_cost_nothing() -> None:
    assert type(foreign(Small).decode) is type(msgspec.msgpack.Decoder(int).decode)


def test_a_default_counts_for_what_its_items_leave_out() -> None:
    schema = describe(Holder)
    fields = schema["types"][schema["root"]]["fields"]
    fields[0]["default"] = [{}] * 500
    assert len(type_support(build(schema)).decode(b"\x80").items) == 500  # type: ignore[attr-defined]
    fields[0]["default"] = [{}] * (MANY + 100)
    with pytest.raises(ConfigurationError, match="elements: more than"):
        build(schema)
    fields[0]["default"] = [{}] * 500
    schema["types"]["a/msg/Ten"] = {
        "fields": [{"name": f"x{at}", "type": schema["root"]} for at in range(10)]
    }
    with pytest.raises(ConfigurationError, match="elements: more than"):
        build({**schema, "root": "a/msg/Ten"})

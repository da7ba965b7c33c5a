"""docs/protocol-fields.md has every field as the classes have it, and its claims about them are true."""

import difflib
import re
from enum import Enum
from pathlib import Path
from typing import Any

import msgspec
import pytest

import fieldspage
from bus.errors import RemoteProtocolError
from bus.msg.std_msgs import Float32, UInt8MultiArray
from bus.types.support import type_support
from bus.wire import messages as m
from fieldspage import groups
from rows import for_each

PROTOCOL = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()
CLASSES = {cls.__name__: cls for one in groups().values() for cls in one}
EMPTY: tuple[Any, ...] = (0, 0.0, "", b"", False, None, ())


def test_the_page_is_made_of_the_classes_of_today() -> None:
    here, made = fieldspage.PAGE.read_text().splitlines(), fieldspage.page().splitlines()
    changed = list(difflib.unified_diff(here, made, "the page", "the classes", lineterm="", n=0))
    assert not changed, "docs/protocol-fields.md is out of date; run: make api\n" + "\n".join(changed[:20])


def test_the_page_has_every_message() -> None:
    assert set(m.Message.__subclasses__()) <= set(CLASSES.values())


@for_each("name", CLASSES)
def test_the_protocol_shows_defaults_that_nobody_would_guess(name: str) -> None:
    """The first row of the message or record says so, because the field is absent from the bytes then."""
    if name == "QoSProfile":
        return  # docs/qos.md has its defaults, and a test of them
    row = next(line for line in PROTOCOL.splitlines() if line.startswith(f"| {name} |"))
    for field in msgspec.structs.fields(CLASSES[name]):
        if field.default is msgspec.NODEFAULT or field.default in EMPTY:
            continue
        shown = field.default.value if isinstance(field.default, Enum) else field.default
        assert f"`{field.encode_name}` = {shown}" in row, f"{name}.{field.encode_name} is {shown} if absent"


def decode(**fields: Any) -> Any:
    return m.from_client.decode(msgspec.msgpack.encode(fields))


def test_the_order_of_the_keys_is_free_and_unknown_ones_are_ignored() -> None:
    assert decode(number=4, later="x", m="ping") == m.Ping(number=4)


def test_an_absent_field_has_its_default() -> None:
    assert decode(m="ring", publisher=2) == m.ReplaceRing(publisher=2, descriptors=1)
    assert decode(m="type", type_name="a/msg/A", type_hash="x").schema == b"\xc0"


@for_each(
    "fields",
    [
        {"m": "ping", "number": 1.0},
        {"m": "ring"},
        {"m": "attach", "subscription": 1, "source": 2, "slot": 65536},
        {"m": "hello", "version": 1, "lease_s": -1},
        {"m": "hello", "version": 1, "program": "x" * 1001},
    ],
)
def test_other_types_missing_fields_and_values_out_of_bounds_are_errors(fields: dict[str, Any]) -> None:
    with pytest.raises(RemoteProtocolError):
        decode(**fields)


def test_a_number_may_be_an_integer_or_a_short_float() -> None:
    for value in (b"\x05", b"\xca\x40\xa0\x00\x00"):
        body = b"\x83\xa1m\xa5hello\xa7version\x01\xa7lease_s" + value
        assert m.from_client.decode(body).lease_s == 5.0


def test_the_examples_of_payloads() -> None:
    examples = dict(re.findall(r"`(\w+\(data=[^`]+\))`\s+is\s+`([0-9a-f ]+)`", PROTOCOL))
    floats, short = type_support(Float32), "91 ca 3f 00 00 00"
    assert bytes.fromhex(examples["Float32(data=0.5)"]) == floats.encode(Float32(data=0.5))
    assert f"and `{short}`" in PROTOCOL
    assert floats.decode(bytes.fromhex(short)) == Float32(data=0.5)
    assert floats.decode(floats.encode(Float32(data=0.1))) == Float32(data=0.1), "all 64 bits, not rounded"
    encoded = type_support(UInt8MultiArray).encode(UInt8MultiArray(data=b"ab"))
    assert bytes.fromhex(examples['UInt8MultiArray(data=b"ab")']) == encoded

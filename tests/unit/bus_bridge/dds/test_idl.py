from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus.types.definitions import names
from bus_ros.cdr import codec_of, schema_of_definition
from rows import for_each

idl = pytest.importorskip("cyclonedds.idl", reason="cyclonedds is not installed: make setup installs it")

from bus_bridge.dds.idl import idl_type  # noqa: E402


def _described(type_name: str, definition: str) -> Any:
    found = idl_type(codec_of(schema_of_definition(type_name, definition)))
    found.__idl__.populate()
    return found


@for_each(
    "field, expected",
    [
        ("bool a", "bool"),
        ("byte a", "byte"),
        ("char a", "uint8"),
        ("string a", "str"),
        ("string<=5 a", "bounded_str[5]"),
        ("float64[9] a", "array[float64, 9]"),
        ("uint8[] a", "sequence[uint8]"),
        ("uint8[<=4] a", "sequence[uint8, 4]"),
        ("uint8[4] a", "array[uint8, 4]"),
        ("int32[<=70000] a", "sequence[int32]"),
        ("string<=3[<=2] a", "sequence[bounded_str[3], 2]"),
    ],
)
def test_fields(field: str, expected: str) -> None:
    found = _described("demo/msg/Field", f"{field}\n").__annotations__["a"]
    text = found.__name__ if isinstance(found, type) else repr(found.__metadata__[0])
    assert expected in text.replace("typedef", "").replace("cyclonedds.idl.types.", "") or expected == text, (
        text
    )


def test_a_message_in_a_message_and_one_without_fields() -> None:
    found = _described("demo/msg/Outer", "demo/Empty[] many\n" + "=" * 80 + "\nMSG: demo/Empty\n")
    assert found.__idl_typename__ == "demo::msg::dds_::Outer_"
    (inner,) = found.__annotations__["many"].__metadata__
    assert inner.subtype.__idl_typename__ == "demo::msg::dds_::Empty_"
    assert list(inner.subtype.__annotations__) == ["structure_needs_at_least_one_member"]


@pytest.mark.nightly
def test_all_shipped_messages_can_be_described() -> None:
    for name in names("msg"):
        try:
            codec = codec_of(MessageSchema.of(message_class(name)))
        except ConfigurationError as error:
            assert "wstring" in str(error)
        else:
            idl_type(codec).__idl__.populate()

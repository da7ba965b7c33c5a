"""The facade's parameters as values: types, messages, texts, files."""

import pickle
from array import array
from pathlib import Path
from typing import Any

import pytest

from bus_ros.rclpy import parameter as parameter_module
from bus_ros.rclpy.parameter import (
    Parameter,
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)
from bus_ros.rosidl import message_class
from rows import for_each

Type = Parameter.Type

EXAMPLES: dict[Any, Any] = {
    Type.NOT_SET: None,
    Type.BOOL: True,
    Type.INTEGER: -5,
    Type.DOUBLE: 1.5,
    Type.STRING: "text",
    Type.BYTE_ARRAY: [b"\x01", b"\xff"],
    Type.BOOL_ARRAY: [True, False],
    Type.INTEGER_ARRAY: [1, 2],
    Type.DOUBLE_ARRAY: [1.5, -2.0],
    Type.STRING_ARRAY: ["a", ""],
}


@for_each("type_", EXAMPLES)
def test_types_and_messages(type_: Any) -> None:
    value = EXAMPLES[type_]
    parameter = Parameter("name", value=value)
    assert (parameter.name, parameter.type_, parameter.value) == ("name", type_, value)
    message = parameter.to_parameter_msg()
    assert (message.name, message.value.type) == ("name", type_.value)
    assert message.value == parameter.get_parameter_value()
    back = Parameter.from_parameter_msg(message)
    assert (back.name, back.type_, back.value) == ("name", type_, value)
    assert parameter_value_to_python(message.value) == value
    assert Parameter("name", type_, value).type_ is type_


def test_type_numbers_are_those_of_the_message() -> None:
    numbers = message_class("rcl_interfaces/msg/ParameterType")
    for type_ in Type:
        assert getattr(numbers, f"PARAMETER_{type_.name}") == type_.value == type_


def test_types_are_printed_and_pickled_by_name() -> None:
    assert str(Type.BOOL) == f"{Type.BOOL}" == "Type.BOOL"
    assert pickle.loads(pickle.dumps(Type.BOOL)) is Type.BOOL
    assert repr(Parameter("a", value=1)) == "Parameter(name='a', type_=Type.INTEGER, value=1)"


def test_values_of_sequences() -> None:
    assert Parameter("a", value=(1, 2)).type_ is Type.INTEGER_ARRAY
    assert Parameter("a", value=array("d", [1.0])).type_ is Type.DOUBLE_ARRAY
    for value in ((1, 2), array("i", [1, 2])):
        assert list(Parameter("a", value=value).get_parameter_value().integer_array_value) == [1, 2]
    # As in ROS 2, an empty list gets the first type that fits.
    assert Parameter("a", value=[]).type_ is Type.BYTE_ARRAY
    assert Parameter("a", Type.STRING_ARRAY, []).to_parameter_msg().value.string_array_value == []


def test_values_that_no_parameter_has() -> None:
    with pytest.raises(TypeError, match=r"The given value is not one of the allowed types '\{\}'"):
        Parameter("a", value={})
    with pytest.raises(TypeError, match="is not a list of one of the allowed types"):
        Parameter("a", value=[1, "b"])
    with pytest.raises(ValueError, match=r"Type 'Type\.BOOL' and value '1' do not agree"):
        Parameter("a", Type.BOOL, 1)
    with pytest.raises(ValueError, match="do not agree"):
        Parameter("a", Type.DOUBLE_ARRAY, 1.0)
    with pytest.raises(TypeError, match="type must be an instance of"):
        Parameter("a", 1, 1)  # type: ignore[arg-type]
    value = message_class("rcl_interfaces/msg/ParameterValue")(type=77)  # type: ignore[call-arg]
    with pytest.raises(RuntimeError, match="unexpected parameter type 77"):
        parameter_value_to_python(value)


def test_message_classes_of_the_module() -> None:
    assert parameter_module.ParameterType is message_class("rcl_interfaces/msg/ParameterType")
    assert parameter_module.ParameterValue is message_class("rcl_interfaces/msg/ParameterValue")
    assert parameter_module.ParameterMsg is message_class("rcl_interfaces/msg/Parameter")
    with pytest.raises(AttributeError, match="no attribute 'Nosuch'"):
        _ = parameter_module.Nosuch


TYPED = {
    "true": (Type.BOOL, True),
    "42": (Type.INTEGER, 42),
    "1.5": (Type.DOUBLE, 1.5),
    "text": (Type.STRING, "text"),
    "'42'": (Type.STRING, "42"),
    "y": (Type.STRING, "y"),
    "": (Type.STRING, ""),
    "{a: 1}": (Type.STRING, "{a: 1}"),
    "[1, a]": (Type.STRING, "[1, a]"),
    "[": (Type.STRING, "["),
    "[]": (Type.BOOL_ARRAY, []),
    "[true]": (Type.BOOL_ARRAY, [True]),
    "[1, 2]": (Type.INTEGER_ARRAY, [1, 2]),
    "[1.5]": (Type.DOUBLE_ARRAY, [1.5]),
    "[a, b]": (Type.STRING_ARRAY, ["a", "b"]),
}


@for_each("text", TYPED)
def test_values_from_text(text: str) -> None:
    value = get_parameter_value(text)
    assert (value.type, parameter_value_to_python(value)) == TYPED[text]


def test_parameters_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text(
        "/**: {ros__parameters: {a: 1, b: 1}}\n"
        "/node: {ros__parameters: {a: 2, c: {d: x}}}\n"
        "/other: {ros__parameters: {a: 3}}\n"
    )

    def values(**options: Any) -> dict[str, Any]:
        found = parameter_dict_from_yaml_file(str(path), **options)
        assert [message.name for message in found.values()] == list(found)
        return {name: parameter_value_to_python(message.value) for name, message in found.items()}

    assert values() == {"a": 3, "c.d": "x"}
    assert values(target_nodes=["/node"]) == {"a": 2, "c.d": "x"}
    assert values(target_nodes=["/node"], use_wildcard=True) == {"a": 2, "b": 1, "c.d": "x"}
    assert values(target_nodes=["node"], namespace="p.") == {"p.a": 2, "p.c.d": "x"}
    with pytest.raises(RuntimeError, match="Param file does not contain parameters for /nosuch"):
        values(target_nodes=["/nosuch"], use_wildcard=True)
    path.write_text("/node: {ros__parameters: {a: []}}")
    assert parameter_dict_from_yaml_file(path)["a"].value.type == Type.BOOL_ARRAY.value
    with pytest.raises(FileNotFoundError):
        parameter_dict_from_yaml_file(tmp_path / "nosuch.yaml")
    path.write_text("")
    with pytest.raises(RuntimeError, match="Param file does not contain selected parameters"):
        values()
    path.write_text("a: 1")
    with pytest.raises(RuntimeError, match="not a valid ROS parameter file"):
        values()
    path.unlink()
    with pytest.raises(FileNotFoundError):
        values()

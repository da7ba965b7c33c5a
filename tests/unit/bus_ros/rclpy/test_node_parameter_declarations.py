"""The facade's parameters of a node: declared, read and listed."""

from typing import Any

import pytest

from bus_ros.rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rosidl import message_class
from rows import for_each

Type = Parameter.Type


def descriptor(**fields: Any) -> Any:
    return message_class("rcl_interfaces/msg/ParameterDescriptor")(**fields)


def node(**options: Any) -> NodeParameters:
    return NodeParameters(**options)


def test_declare_and_get() -> None:
    parameters = node()
    assert parameters.declare_parameter("a", 1).value == 1
    assert parameters.has_parameter("a")
    assert not parameters.has_parameter("b")
    assert parameters.get_parameter("a").value == 1
    assert parameters.get_parameter_type("a") is Type.INTEGER
    assert [one.value for one in parameters.get_parameters(["a", "a"])] == [1, 1]
    with pytest.raises(ParameterAlreadyDeclaredException, match="already declared"):
        parameters.declare_parameter("a", 2)
    with pytest.raises(InvalidParameterException):
        parameters.declare_parameter("", 1)


def test_declare_several() -> None:
    parameters = node(overrides={"ns.b": "from outside"})
    found = parameters.declare_parameters("ns", [("a", 1), ("b", "x", descriptor(description="d"))])
    assert [(one.name, one.value) for one in found] == [("ns.a", 1), ("ns.b", "from outside")]
    assert parameters.describe_parameter("ns.b").description == "d"
    with pytest.raises(ParameterAlreadyDeclaredException):
        parameters.declare_parameters("ns", [("c", 1), ("a", 1)])
    assert not parameters.has_parameter("ns.c")


@for_each(
    ("entry", "text"),
    [
        ((), "expecting length between 1 and 3"),
        (("a", 1, descriptor(), 2), "expecting length between 1 and 3"),
        ((5, 1), "First element 5 at index 1 in parameters list is not a str"),
        (("a", 1, "b"), "Third element b at index 1 in parameters list is not a ParameterDescriptor"),
    ],
)
def test_entries_that_declare_nothing(entry: tuple[Any, ...], text: str) -> None:
    parameters = node()
    with pytest.raises(TypeError, match=text):
        parameters.declare_parameters("", [("first", 1), entry])
    assert not parameters.has_parameter("first")


def test_a_name_only_is_deprecated() -> None:
    parameters = node(overrides={"b": 5})
    with pytest.warns(UserWarning, match="declaring a parameter only providing its name is deprecated"):
        assert parameters.declare_parameter("a").value is None
    with pytest.warns(UserWarning, match="named 'b'"):
        assert parameters.declare_parameter("b").value == 5
    assert parameters.set_parameters([Parameter("a", value="now")])[0].successful
    assert parameters.get_parameter("a").value == "now"


def test_a_type_only() -> None:
    parameters = node(overrides={"b": 5, "c": "x"})
    assert parameters.declare_parameter("a", Type.STRING).type_ is Type.NOT_SET
    with pytest.raises(ParameterUninitializedException, match="'a' is not initialized"):
        parameters.get_parameter("a")
    assert parameters.get_parameter_or("a", Parameter("a", value="other")).value == "other"
    assert not parameters.set_parameters([Parameter("a", value=1)])[0].successful
    assert parameters.set_parameters([Parameter("a", value="x")])[0].successful
    assert parameters.get_parameter("a").value == "x"
    assert parameters.declare_parameter("b", Type.INTEGER).value == 5
    with pytest.raises(InvalidParameterTypeException):
        parameters.declare_parameter("c", Type.INTEGER)
    with pytest.raises(ValueError, match="statically typed of type NOT_SET"):
        parameters.declare_parameter("d", Type.NOT_SET)
    with pytest.raises(ValueError, match="dynamic_typing=True"):
        parameters.declare_parameter("d", Type.BOOL, descriptor(dynamic_typing=True))


def test_a_message_as_default() -> None:
    parameters = node()
    assert parameters.declare_parameter("a", Parameter("", value=[1.5]).get_parameter_value()).value == [1.5]
    with pytest.raises(ValueError, match="default value of type PARAMETER_NOT_SET"):
        parameters.declare_parameter("b", Parameter("").get_parameter_value())


def test_overrides() -> None:
    parameters = node(overrides={"a": 1, "b": 1}, parameter_overrides=[Parameter("b", value=2)])
    assert parameters.declare_parameter("a", 10).value == 1
    assert parameters.declare_parameter("b", 10).value == 2
    assert not parameters.has_parameter("c")
    with pytest.raises(InvalidParameterTypeException) as caught:
        node(overrides={"x": 1}).declare_parameter("x", 1.0)
    assert "Trying to set parameter 'x' to '1' of type 'INTEGER', expecting type 'DOUBLE'" in str(
        caught.value
    )
    assert node(overrides={"x": 1}).declare_parameter("x", 1.0, ignore_override=True).value == 1.0


def test_overrides_are_declared_at_once() -> None:
    parameters = node(overrides={"a": 1, "b.c": "x"}, automatically_declare_parameters_from_overrides=True)
    assert {name: one.value for name, one in parameters.get_parameters_by_prefix("").items()} == {
        "a": 1,
        "b.c": "x",
    }
    assert not parameters.set_parameters([Parameter("a", value="x")])[0].successful


def test_undeclare() -> None:
    parameters = node()
    parameters.declare_parameter("a", 1)
    parameters.declare_parameter("fixed", 1, descriptor(read_only=True))
    parameters.undeclare_parameter("a")
    assert not parameters.has_parameter("a")
    with pytest.raises(ParameterNotDeclaredException):
        parameters.undeclare_parameter("a")
    with pytest.raises(ParameterImmutableException):
        parameters.undeclare_parameter("fixed")


def test_undeclared() -> None:
    parameters = node()
    for use in (
        lambda: parameters.get_parameter("a"),
        lambda: parameters.get_parameters(["a"]),
        lambda: parameters.get_parameter_type("a"),
        lambda: parameters.set_parameters([Parameter("a", value=1)]),
        lambda: parameters.set_parameters_atomically([Parameter("a", value=1)]),
        lambda: parameters.describe_parameter("a"),
        lambda: parameters.describe_parameters(["a"]),
        lambda: parameters.set_descriptor("a", descriptor()),
    ):
        with pytest.raises(ParameterNotDeclaredException):
            use()
    assert parameters.get_parameter_or("a").type_ is Type.NOT_SET


def test_undeclared_where_that_is_allowed() -> None:
    parameters = node(allow_undeclared_parameters=True)
    assert parameters.get_parameter("a").value is None
    assert parameters.get_parameter_types(["a"]) == [Type.NOT_SET]
    assert parameters.describe_parameter("a") == descriptor()
    assert parameters.set_descriptor("a", descriptor()).type == 0
    assert parameters.set_parameters([Parameter("a", value=1)])[0].successful
    assert parameters.set_parameters([Parameter("a", value="x")])[0].successful
    assert parameters.describe_parameter("a").dynamic_typing
    assert parameters.set_parameters([Parameter("a")])[0].successful
    assert not parameters.has_parameter("a")


def test_names_must_be_texts() -> None:
    parameters = node()
    for use in (parameters.get_parameters, parameters.get_parameter_types, parameters.describe_parameters):
        with pytest.raises(TypeError, match="All names must be instances of type str"):
            use([1])  # type: ignore[list-item]


def test_prefixes() -> None:
    parameters = node()
    parameters.declare_parameters("", [("a", 1), ("b.c", 2), ("b.d.e", 3), ("bb", 4)])
    assert {name: one.value for name, one in parameters.get_parameters_by_prefix("b").items()} == {
        "c": 2,
        "d.e": 3,
    }
    cases: dict[tuple[tuple[str, ...], int], tuple[list[str], list[str]]] = {
        ((), 0): (["a", "b.c", "b.d.e", "bb"], ["b", "b.d"]),
        ((), 1): (["a", "bb"], []),
        ((), 2): (["a", "b.c", "bb"], ["b"]),
        (("b",), 0): (["b.c", "b.d.e"], ["b", "b.d"]),
        (("b",), 1): (["b.c"], ["b"]),
        (("a", "b.d"), 0): (["a", "b.d.e"], ["b.d"]),
        (("nosuch",), 0): ([], []),
    }
    for (prefixes, depth), (names, above) in cases.items():
        found = parameters.list_parameters(list(prefixes), depth)
        assert (list(found.names), list(found.prefixes)) == (names, above), (prefixes, depth)
    with pytest.raises(TypeError):
        parameters.list_parameters("b", 0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="negative"):
        parameters.list_parameters([], -1)

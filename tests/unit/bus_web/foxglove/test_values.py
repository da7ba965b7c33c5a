"""Values of parameters in JSON, and in the form of ROS 2."""

from typing import Any

import pytest

from bus.parameters.messages import value_message
from bus.parameters.values import ParameterType
from bus.types.classes import message_class
from bus_web.foxglove.protocol import Misunderstood, Parameter
from bus_web.foxglove.values import join, parameter_of, split, value_of
from rows import for_each

T = ParameterType


@for_each(
    ("kind", "value", "told"),
    [
        (T.NOT_SET, None, Parameter("/n.p")),
        (T.BOOL, True, Parameter("/n.p", True)),
        (T.INTEGER, 3, Parameter("/n.p", 3)),
        (T.DOUBLE, 3.0, Parameter("/n.p", 3.0, "float64")),
        (T.STRING, "x", Parameter("/n.p", "x")),
        (T.BYTE_ARRAY, b"ab", Parameter("/n.p", "YWI=", "byte_array")),
        (T.INTEGER_ARRAY, [1, 2], Parameter("/n.p", [1, 2])),
        (T.DOUBLE_ARRAY, [1.0], Parameter("/n.p", [1.0], "float64_array")),
        (T.STRING_ARRAY, ["a"], Parameter("/n.p", ["a"])),
    ],
)
def test_both_ways(kind: ParameterType, value: Any, told: Parameter) -> None:
    message = value_message(lambda name: message_class(f"rcl_interfaces/msg/{name}"), kind, value)
    assert parameter_of("/n.p", message) == told
    assert value_of(told, kind) == (kind, value)


@for_each(
    ("said", "present", "meant"),
    [
        (Parameter("", 1), T.NOT_SET, (T.INTEGER, 1)),
        (Parameter("", 1), T.DOUBLE, (T.DOUBLE, 1.0)),
        (Parameter("", 1, "float64"), T.NOT_SET, (T.DOUBLE, 1.0)),
        (Parameter("", [1, 2]), T.DOUBLE_ARRAY, (T.DOUBLE_ARRAY, [1.0, 2.0])),
        (Parameter("", [1, 2.5]), T.NOT_SET, (T.DOUBLE_ARRAY, [1.0, 2.5])),
        (Parameter("", []), T.STRING_ARRAY, (T.STRING_ARRAY, [])),
        (Parameter("", []), T.BYTE_ARRAY, (T.BYTE_ARRAY, b"")),
        (Parameter("", []), T.NOT_SET, (T.BOOL_ARRAY, [])),
    ],
)
def test_what_is_meant(said: Parameter, present: ParameterType, meant: tuple[ParameterType, Any]) -> None:
    assert value_of(said, present) == meant


@pytest.mark.parametrize(
    "said",
    [
        Parameter("/n.p", {"a": 1}),
        Parameter("/n.p", [1, "a"]),
        Parameter("/n.p", [[1]]),
        Parameter("/n.p", 2**63),
        Parameter("/n.p", "é!", "byte_array"),
        Parameter("/n.p", 5, "float64_array"),
        Parameter("/n.p", True, "float64"),
    ],
)
def test_what_is_no_value(said: Parameter) -> None:
    with pytest.raises(Misunderstood, match=r"^/n\.p: .* is not a parameter value$"):
        value_of(said, ParameterType.NOT_SET)


def test_names() -> None:
    assert join("/robot/arm", "gains.p") == "/robot/arm.gains.p"
    assert split("/robot/arm.gains.p") == ("/robot/arm", "gains.p")
    assert [split(name) for name in ("/arm", "arm.p", "/arm.", "")] == [None] * 4

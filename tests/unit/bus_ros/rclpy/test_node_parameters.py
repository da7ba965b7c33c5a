"""The facade's parameters of a node: set, with rules and callbacks, and described."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.parameters.messages import event_message
from bus.parameters.store import Change
from bus_ros.rclpy.exceptions import (
    InvalidParameterValueException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
)
from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rosidl import message_class
from rows import for_each

Type = Parameter.Type


def descriptor(**fields: Any) -> Any:
    return message_class("rcl_interfaces/msg/ParameterDescriptor")(**fields)


def integers(low: int, high: int, step: int = 0) -> Any:
    return message_class("rcl_interfaces/msg/IntegerRange")(from_value=low, to_value=high, step=step)  # type: ignore[call-arg]


def floats(low: float, high: float, step: float = 0.0) -> Any:
    return message_class("rcl_interfaces/msg/FloatingPointRange")(from_value=low, to_value=high, step=step)  # type: ignore[call-arg]


def result(successful: bool, reason: str = "") -> Any:
    return message_class("rcl_interfaces/msg/SetParametersResult")(successful=successful, reason=reason)  # type: ignore[call-arg]


def node(**options: Any) -> NodeParameters:
    return NodeParameters(**options)


# --- setting


def test_types_are_static() -> None:
    parameters = node()
    parameters.declare_parameter("a", 1)
    wrong = parameters.set_parameters([Parameter("a", value=1.5)])[0]
    assert wrong == result(False, "Wrong parameter type, expected 'Type.INTEGER' got 'Type.DOUBLE'")
    assert parameters.set_parameters([Parameter("a")])[0] == result(
        False, "Static parameter cannot be undeclared"
    )
    assert parameters.get_parameter("a").value == 1


def test_types_are_dynamic_where_that_is_asked_for() -> None:
    parameters = node()
    parameters.declare_parameter("a", 1, descriptor(dynamic_typing=True))
    assert parameters.set_parameters([Parameter("a", value="x")])[0].successful
    assert parameters.describe_parameter("a").type == Type.STRING
    assert parameters.set_parameters([Parameter("a")])[0].successful
    assert not parameters.has_parameter("a")


def test_read_only() -> None:
    parameters = node(overrides={"a": 5})
    assert parameters.declare_parameter("a", 1, descriptor(read_only=True)).value == 5
    refused = parameters.set_parameters([Parameter("a", value=2)])[0]
    assert refused == result(False, "Trying to set a read-only parameter: a.")
    with pytest.raises(ParameterImmutableException):
        parameters.set_descriptor("a", descriptor())


RANGES: list[tuple[Any, Any, str]] = [
    (integers(0, 10), 5, ""),
    (integers(10, 0), 10, ""),
    (integers(0, 10), 11, "Parameter a out of range. Min: 0, Max: 10, value: 11"),
    (integers(0, 10, 5), 5, ""),
    (integers(0, 11, 5), 11, ""),
    (
        integers(0, 10, 5),
        6,
        "The parameter value for a is not a valid step. Min: 0, max: 10, value: 6, step: 5",
    ),
    (floats(0.0, 1.0), 0.5, ""),
    (floats(0.0, 1.0), 1.0 + 1e-9, ""),
    (floats(0.0, 1.0), 1.5, "Parameter a out of range. Min: 0.0, Max: 1.0, value: 1.5"),
    (floats(0.0, 1.0), math.nan, "Parameter a out of range. Min: 0.0, Max: 1.0, value: nan"),
    (floats(0.0, 1.0, 0.1), 0.30000000000000004, ""),
    (
        floats(0.0, 1.0, 0.1),
        0.25,
        "The parameter value for a is not close enough to a valid step. "
        "Min: 0.0, max: 1.0, value: 0.25, step: 0.1",
    ),
]


@for_each(("allowed", "value", "reason"), RANGES)
def test_ranges(allowed: Any, value: Any, reason: str) -> None:
    field = "integer_range" if isinstance(value, int) else "floating_point_range"
    parameters = node()
    parameters.declare_parameter("a", type(value)(0), descriptor(**{field: [allowed]}))
    assert parameters.set_parameters([Parameter("a", value=value)]) == [result(not reason, reason)]
    if reason:
        with pytest.raises(InvalidParameterValueException):
            node().declare_parameter("a", value, descriptor(**{field: [allowed]}))


def test_atomically() -> None:
    parameters = node()
    parameters.declare_parameters("", [("a", 1), ("b", 1)])
    refused = parameters.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value="x")])
    assert not refused.successful
    assert parameters.get_parameter("a").value == 1
    assert parameters.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value=2)]).successful
    assert [one.value for one in parameters.get_parameters(["a", "b"])] == [2, 2]
    with pytest.raises(ParameterNotDeclaredException, match="c"):
        parameters.set_parameters_atomically([Parameter("a", value=3), Parameter("c", value=3)])
    assert parameters.get_parameter("a").value == 2
    each = parameters.set_parameters([Parameter("a", value=4), Parameter("b", value="x")])
    assert [one.successful for one in each] == [True, False]
    assert not parameters.set_parameters_atomically([]).successful


# --- callbacks and changes


def test_a_callback_refuses() -> None:
    parameters = node()
    seen: list[Any] = []

    def check(wanted: list[Parameter]) -> Any:
        seen.append([(one.name, one.value) for one in wanted])
        return result(wanted[0].value != 13, "unlucky")

    parameters.add_on_set_parameters_callback(check)
    parameters.declare_parameter("a", 1)
    assert parameters.set_parameters([Parameter("a", value=13)]) == [result(False, "unlucky")]
    assert parameters.get_parameter("a").value == 1
    assert parameters.set_parameters([Parameter("a", value=2)])[0].successful
    with pytest.raises(InvalidParameterValueException, match="Reason: unlucky"):
        parameters.declare_parameter("b", 13)
    assert not parameters.has_parameter("b")
    assert seen == [[("a", 1)], [("a", 13)], [("a", 2)], [("b", 13)]]
    parameters.remove_on_set_parameters_callback(check)
    assert parameters.set_parameters([Parameter("a", value=13)])[0].successful
    with pytest.raises(ValueError, match="not in list"):
        parameters.remove_on_set_parameters_callback(check)


@pytest.mark.parametrize("result", [None, True, "fine", (True, "")])
def test_a_callback_without_a_result_refuses(result: Any) -> None:
    parameters = node()
    parameters.declare_parameter("a", 1)
    parameters.add_on_set_parameters_callback(lambda wanted: result)
    with pytest.warns(UserWarning, match=r"must return a SetParametersResult, not "):
        outcome = parameters.set_parameters([Parameter("a", value=2)])[0]
    assert (outcome.successful, outcome.reason) == (False, "Callback returned an invalid type")
    with pytest.warns(UserWarning), pytest.raises(InvalidParameterValueException, match="invalid type"):
        parameters.declare_parameter("b", 1)
    assert parameters.get_parameter("a").value == 1 and not parameters.has_parameter("b")


def test_a_descriptor_without_a_value_needs_a_dynamic_type() -> None:
    parameters = node()
    for described in (descriptor(), descriptor(type=4)):
        with pytest.raises(ValueError, match="statically typed parameter with default value of type"):
            parameters.declare_parameter("a", descriptor=described)
    assert parameters.declare_parameter("a", descriptor=descriptor(dynamic_typing=True)).value is None


def test_the_depth_of_a_list_is_a_number() -> None:
    with pytest.raises(TypeError, match="depth must be instance of type int"):
        node().list_parameters([], "1")  # type: ignore[arg-type]


def test_the_callback_that_came_last_is_asked_first() -> None:
    parameters = node()
    order: list[str] = []

    def noting(name: str, outcome: Any) -> Callable[[Any], Any]:
        return lambda wanted: order.append(name) or outcome

    parameters.add_on_set_parameters_callback(noting("first", result(True)))
    parameters.add_on_set_parameters_callback(noting("second", result(True)))
    parameters.add_post_set_parameters_callback(noting("after", None))
    parameters.declare_parameter("a", 1)
    assert order == ["second", "first", "after"]


def test_before_and_after() -> None:
    parameters = node()
    parameters.declare_parameters("", [("a", 1), ("b", 1)])
    after: list[Any] = []

    def both(wanted: list[Parameter]) -> list[Parameter]:
        return [*wanted, Parameter("b", value=wanted[0].value * 2)]

    def note(done: list[Parameter]) -> None:
        after.append({one.name: parameters.get_parameter(one.name).value for one in done})

    parameters.add_pre_set_parameters_callback(both)
    parameters.add_post_set_parameters_callback(note)
    assert parameters.set_parameters([Parameter("a", value=5)])[0].successful
    assert not parameters.set_parameters([Parameter("a", value=1.5)])[0].successful
    assert after == [{"a": 5, "b": 10}]
    parameters.remove_pre_set_parameters_callback(both)
    parameters.remove_post_set_parameters_callback(note)
    parameters.set_parameters([Parameter("a", value=6)])
    assert parameters.get_parameter("b").value == 10
    assert len(after) == 1
    parameters.add_pre_set_parameters_callback(lambda wanted: [])
    assert "parameter list cannot be empty" in parameters.set_parameters([Parameter("a", value=7)])[0].reason


def test_changes_are_told() -> None:
    changes: list[Change[Parameter]] = []
    parameters = node(on_change=changes.append)
    parameters.declare_parameter("a", 1, descriptor(dynamic_typing=True))
    parameters.declare_parameter("unset", Type.STRING)
    parameters.set_parameters([Parameter("a", value=2), Parameter("unset", value="x")])
    parameters.set_parameters([Parameter("a")])
    names = [tuple([one.name for one in part] for part in change) for change in changes]
    assert names == [(["a"], [], []), ([], ["a"], []), (["unset"], [], []), ([], [], ["a"])]
    events = [event_message(parameter_message, "/ns/node", change) for change in changes]
    assert events[1].node == "/ns/node"
    assert events[1].changed_parameters == [Parameter("a", value=2).to_parameter_msg()]
    assert events[3].deleted_parameters[0].value.type == 0


# --- descriptors


def test_descriptors() -> None:
    parameters = node()
    own = descriptor(description="d", integer_range=[integers(0, 10)])
    parameters.declare_parameter("a", 1, own)
    parameters.declare_parameter("b", 1, own)
    described = parameters.describe_parameters(["a", "b"])
    assert [(one.name, one.type, one.description) for one in described] == [("a", 2, "d"), ("b", 2, "d")]
    assert (own.name, own.type) == ("", 0)


def test_set_descriptor() -> None:
    parameters = node()
    parameters.declare_parameter("a", 50)
    narrow = descriptor(type=2, integer_range=[integers(0, 10)])
    with pytest.raises(InvalidParameterValueException, match="out of range"):
        parameters.set_descriptor("a", narrow)
    assert parameters.get_parameter("a").value == 50
    value = parameters.set_descriptor("a", narrow, Parameter("", value=10).get_parameter_value())
    assert (value.integer_value, parameters.get_parameter("a").value) == (10, 10)
    assert not parameters.set_parameters([Parameter("a", value=11)])[0].successful
    assert parameters.set_descriptor("a", descriptor(type=2, description="wide")).integer_value == 10
    assert parameters.set_parameters([Parameter("a", value=11)])[0].successful
    assert parameters.describe_parameter("a").description == "wide"


@given(st.data())
def test_a_refused_change_changes_nothing(data: st.DataObject) -> None:
    names = ["a", "b", "c"]
    parameters = node()
    parameters.declare_parameters(
        "", [(name, 0, descriptor(integer_range=[integers(0, 5)])) for name in names]
    )
    values = st.one_of(st.integers(-2, 8), st.booleans(), st.floats(allow_nan=False), st.text(max_size=2))
    wanted = data.draw(st.dictionaries(st.sampled_from(names), values, min_size=1))
    before = {name: parameters.get_parameter(name).value for name in names}
    outcome = parameters.set_parameters_atomically(
        [Parameter(name, value=value) for name, value in wanted.items()]
    )
    is_allowed = all(type(value) is int and 0 <= value <= 5 for value in wanted.values())
    assert outcome.successful == is_allowed
    assert bool(outcome.reason) != is_allowed
    after = {name: parameters.get_parameter(name).value for name in names}
    assert after == (before | wanted if is_allowed else before)

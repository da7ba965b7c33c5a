"""The parameters of a `bus.Node`: plain Python values, types, ranges, callbacks, and the texts of errors."""

import enum
import math
from array import array
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import CommandLineError, ConfigurationError, ParameterError
from bus.parameters.parameter_set import Description, Parameter, ParameterSet
from bus.parameters.store import Change, Outcome
from bus.parameters.values import ParameterType
from rows import for_each


def parameters(**overrides: Any) -> ParameterSet:
    return ParameterSet("/robot", overrides)


def refusal(call: Callable[..., object], *arguments: Any, **options: Any) -> str:
    with pytest.raises((ParameterError, CommandLineError)) as found:
        call(*arguments, **options)
    assert ("as the command line says" in str(found.value)) is (found.type is CommandLineError)
    return str(found.value)


class Gear(enum.IntEnum):
    FIRST = 1


class Text(enum.StrEnum):
    A = "a"


VALUES: list[tuple[Any, ParameterType, Any]] = [
    (True, ParameterType.BOOL, True),
    (-5, ParameterType.INTEGER, -5),
    (Gear.FIRST, ParameterType.INTEGER, 1),
    (1.5, ParameterType.DOUBLE, 1.5),
    ("text", ParameterType.STRING, "text"),
    (Text.A, ParameterType.STRING, "a"),
    (b"\1\xff", ParameterType.BYTE_ARRAY, b"\1\xff"),
    (bytearray(b"\1"), ParameterType.BYTE_ARRAY, b"\1"),
    ([b"\1", b"\2"], ParameterType.BYTE_ARRAY, b"\1\2"),
    ([True, False], ParameterType.BOOL_ARRAY, [True, False]),
    ((1, 2), ParameterType.INTEGER_ARRAY, [1, 2]),
    (array("d", [1.5]), ParameterType.DOUBLE_ARRAY, [1.5]),
    ([1, 2.5], ParameterType.DOUBLE_ARRAY, [1.0, 2.5]),
    (["a", ""], ParameterType.STRING_ARRAY, ["a", ""]),
]


@for_each(("given_", "type_", "value"), VALUES)
def test_values_and_their_types(given_: Any, type_: ParameterType, value: Any) -> None:
    some = parameters()
    returned = some.declare("a", given_)
    assert returned == some.get("a") == value
    assert type(returned) is type(value)
    assert some.find("a").parameter == Parameter("a", type_, value)


@for_each("value", [{}, ..., 1j, [1, "a"], [1, True], [False, 0], [[1]], [None], {1}])
def test_no_values(value: Any) -> None:
    said = refusal(parameters().declare, "a", value)
    assert said.startswith("parameter 'a' of /robot: can't be ")
    assert "a value is bool, int, float, str, bytes, or a list of bool, int, float or str" in said


def test_integers_have_64_bits() -> None:
    some = parameters()
    assert some.declare("least", -(2**63)) == -(2**63)
    for value in (2**63, [0, 2**63], -(2**63) - 1):
        assert refusal(some.declare, "a", value).endswith(": an integer has 64 bits")


def test_lists_are_copies() -> None:
    some, mine = parameters(), [1, 2]
    returned = some.declare("a", mine)
    mine.append(3)
    returned.append(4)
    some.get("a").append(5)
    some.below("")["a"].append(6)
    assert some.get("a") == [1, 2]


# --- declaring


def test_declared_once_and_by_a_name() -> None:
    some = parameters()
    some.declare("a", 1)
    assert refusal(some.declare, "a", 1) == "parameter 'a' of /robot: is declared already"
    assert "a name is a text that is not empty" in refusal(some.declare, "", 1)
    assert "a name is a text that is not empty" in refusal(some.declare, 5, 1)


def test_the_command_line_goes_before_the_default() -> None:
    some = parameters(rate=20.0, ids=[], label=5)
    assert some.declare("rate", 10.0) == 20.0
    assert some.declare("ids", [1]) == []
    assert refusal(some.declare, "label", "x") == (
        "parameter 'label' of /robot: can't be 5, as the command line says: "
        "Wrong parameter type, expected 'Type.STRING' got 'Type.INTEGER'"
    )
    assert "label" not in some


def test_the_command_line_tells_integers_from_doubles() -> None:
    assert refusal(parameters(rate=5).declare, "rate", 10.0) == (
        "parameter 'rate' of /robot: can't be 5, as the command line says: "
        "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.INTEGER'; write 5.0"
    )
    assert "got 'Type.INTEGER_ARRAY'" in refusal(parameters(rates=[1]).declare, "rates", [1.5])


def test_a_type_in_place_of_a_default() -> None:
    some = parameters(given=5, wrong=1)
    assert some.declare("given", type_=int) == 5
    assert some.declare("port", type_=int) is None
    assert "port" in some and some.below("") == {"given": 5}
    assert refusal(some.get, "port") == (
        "parameter 'port' of /robot: has no value yet; give it one on the command line: -p port:=..."
    )
    some.set({"port": 80})
    assert some.get("port") == 80
    assert "expected 'Type.STRING'" in refusal(some.declare, "wrong", type_=str)
    assert some.declare("names", [], type_=list[str]) == []
    some.set({"names": ["a"]})
    assert some.declare("octets", [], type_=bytes) == b""
    assert some.declare("ratio", 1, type_=float) == 1.0
    assert refusal(some.declare, "b", 1.5, type_=int).endswith(": the default 1.5 is no integer")
    assert "no parameter has the type <class 'dict'>" in refusal(some.declare, "b", type_=dict)
    assert "say its type, as in type=float" in refusal(some.declare, "b")
    assert "say its type, as in type=list[float]" in refusal(some.declare, "b", [])
    assert "b" not in some


def test_what_each_node_has_can_be_declared_with_another_default() -> None:
    def node(**overrides: Any) -> ParameterSet:
        return ParameterSet("/robot", overrides, {"use_sim_time": False})

    some = node()
    assert some.get("use_sim_time") is False
    assert some.declare("use_sim_time", True) is True
    assert "is declared already" in refusal(some.declare, "use_sim_time", True)
    assert node(use_sim_time=False).declare("use_sim_time", True) is False
    assert "can't be 'x', as the command line says" in refusal(node, use_sim_time="x")


def test_names_that_are_near() -> None:
    some = parameters()
    some.declare("rate", 1.0)
    assert refusal(some.get, "rat") == "parameter 'rat' of /robot: is not declared; did you mean 'rate'?"
    assert refusal(some.set, {"xyz": 1}) == "parameter 'xyz' of /robot: is not declared"
    with pytest.raises(ParameterError) as found:
        some.undeclare("rat")
    assert found.value.name == "rat"


def test_below_a_prefix() -> None:
    some = parameters()
    for name in ("arm.length", "arm.joint.gain", "arms", "speed"):
        some.declare(name, 1)
    assert set(some.below("arm")) == {"length", "joint.gain"}
    assert set(some.below("")) == {"arm.length", "arm.joint.gain", "arms", "speed"}
    assert some.find_below(["arm"], 1) == (["arm.length"], ["arm"])


# --- setting


def test_types_stay() -> None:
    some = parameters()
    some.declare("rate", 10.0)
    some.set({"rate": 5})  # in Python's type hints, an int is also a float
    assert type(some.get("rate")) is float
    some.declare("rates", [1.5])
    some.set({"rates": [1, 2]})
    assert some.get("rates") == [1.0, 2.0]
    some.declare("count", 1)
    assert refusal(some.set, {"count": 1.0}) == (
        "parameter 'count' of /robot: can't be 1.0: "
        "Wrong parameter type, expected 'Type.INTEGER' got 'Type.DOUBLE'"
    )
    assert "can't be True" in refusal(some.set, {"count": True})
    assert "can't be None" in refusal(some.set, {"count": None})
    assert some.change([Parameter("rate", ParameterType.INTEGER, 5)]) == Outcome(
        False, "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.INTEGER'"
    )


def test_types_are_dynamic_where_that_is_asked_for() -> None:
    some = parameters(late="x")
    assert some.declare("a", 1, is_dynamic=True) == 1
    some.set({"a": "text"})
    assert some.get("a") == "text"
    some.set({"a": 1.5})
    some.set({"a": 2})
    assert type(some.get("a")) is int
    assert some.declare("b", is_dynamic=True) is None
    assert some.get("b") is None
    assert some.declare("late", 1, is_dynamic=True) == "x"
    assert some.change([Parameter("a", ParameterType.NOT_SET, None)]).successful
    assert "a" not in some
    assert "either a type or a dynamic one" in refusal(some.declare, "c", type_=int, is_dynamic=True)


def test_read_only() -> None:
    some = parameters(a=5)
    assert some.declare("a", 1, is_read_only=True) == 5
    assert "Trying to set a read-only parameter: a." in refusal(some.set, {"a": 1})
    assert "is read-only" in refusal(some.undeclare, "a")
    some.declare("b", 1)
    some.undeclare("b")
    assert "b" not in some


def test_all_or_none() -> None:
    some = parameters()
    some.declare("a", 1, limits=(0, 5))
    some.declare("b", 1)
    assert refusal(some.set, {"b": 2, "a": 9}) == (
        "parameters of /robot can't be set to b=2, a=9: Parameter a out of range. Min: 0, Max: 5, value: 9"
    )
    assert some.below("") == {"a": 1, "b": 1}
    some.set({"b": 2, "a": 5})
    some.set({})
    assert some.below("") == {"a": 5, "b": 2}


# --- ranges


def test_ranges() -> None:
    some = parameters()
    assert some.declare("rate", 10.0, limits=(1, 100)) == 10.0
    assert refusal(some.set, {"rate": 1000}) == (
        "parameter 'rate' of /robot: can't be 1000.0: "
        "Parameter rate out of range. Min: 1.0, Max: 100.0, value: 1000.0"
    )
    some.declare("even", 2, limits=(0, 10, 2))
    assert "not a valid step. Min: 0, max: 10, value: 3, step: 2" in refusal(some.set, {"even": 3})
    assert "out of range" in refusal(some.set, {"rate": math.nan})
    for low, high, step in ((-math.inf, math.inf, 1.0), (0.0, math.inf, 1e-300), (0.0, 1.0, 5e-324)):
        name = f"from {low} to {high}"
        some.declare(name, 0.5, limits=(low, high, step))
        some.set({name: 0.75})  # every value fits such a step
    assert "out of range" in refusal(some.declare, "a", 5, limits=(0, 1))
    out = refusal(parameters(a=7).declare, "a", 1, limits=(0, 5))
    assert "can't be 7, as the command line says: Parameter a out of range. Min: 0, Max: 5, value: 7" in out


@for_each(
    ("default", "limits", "said"),
    [
        (1, (0,), "range=(0,) is not (lowest, highest) or (lowest, highest, step), each int"),
        (1, (0.5, 3), "each int"),
        (1.0, (0.0, "x"), "each float"),
        (1, (5, 0), "the lowest stands first"),
        (1.0, (0.0, math.nan), "the lowest stands first"),
        (1, (0, 5, -1), "a step is not below 0"),
        (1, (0, 2**63), "an integer has 64 bits"),
        (1, 5, "range=5 is not (lowest, highest)"),
        (1, range(1, 100), "range=range(1, 100) is not (lowest, highest)"),
        ("x", (0, 5), "is string and can't have a range; only an int or a float can"),
        ([1], (0, 5), "is integer array and can't have a range"),
    ],
)
def test_ranges_that_are_none(default: Any, limits: Any, said: str) -> None:
    assert said in refusal(parameters().declare, "a", default, limits=limits)


@given(st.data())
def test_a_number_is_taken_exactly_where_it_is_in_its_range(data: st.DataObject) -> None:
    numbers: Any = data.draw(
        st.sampled_from([st.integers(-(2**63), 2**63 - 1), st.floats(-1e9, 1e9), st.floats()])
    )
    ends = numbers.filter(lambda number: number == number)
    low, high = sorted((data.draw(ends), data.draw(ends)))
    value = data.draw(st.one_of(numbers, st.sampled_from([low, high])))
    some = parameters()
    some.declare("a", low, limits=(low, high))
    try:
        some.set({"a": value})
    except ParameterError as error:
        assert not low <= value <= high
        assert f"Min: {low}, Max: {high}, value: {value}" in str(error)
        assert some.get("a") == low
    else:
        near = isinstance(value, float) and any(
            math.isclose(value, end, rel_tol=1e-6) for end in (low, high)
        )  # as in ROS 2
        assert low <= value <= high or near
        assert some.get("a") == value


# --- callbacks


def test_a_callback_refuses_with_a_reason() -> None:
    some = parameters()
    seen: list[Any] = []

    def check(values: dict[str, Any]) -> str | None:
        seen.append(values)
        return "too fast" if values.get("speed", 0) > 5 else None

    some.add_on_set(check)
    some.declare("speed", 1.5)
    assert refusal(some.set, {"speed": 9}) == "parameter 'speed' of /robot: can't be 9.0: too fast"
    assert some.change([Parameter("speed", ParameterType.DOUBLE, 8.0)]) == Outcome(False, "too fast")
    assert some.get("speed") == 1.5
    assert seen == [{"speed": 1.5}, {"speed": 9.0}, {"speed": 8.0}]
    some.remove(check)
    some.set({"speed": 9})
    with pytest.raises(ConfigurationError, match="is no callback for parameters of /robot"):
        some.remove(check)


def test_a_callback_with_another_answer() -> None:
    some = parameters()
    some.declare("a", 1)
    some.add_on_set(lambda values: False)  # type: ignore[arg-type, return-value]
    with pytest.raises(TypeError, match="must return None, or why not as a str; not False"):
        some.set({"a": 2})
    assert some.get("a") == 1


def test_before_and_after() -> None:
    some = parameters()
    changes: list[Any] = []
    some.declare("a", 1)
    some.declare("b", 1)
    some.add_pre_set(lambda values: values | {"b": values["a"] * 2})
    some.add_post_set(lambda values: changes.append((values, some.get("b"))))
    some.set({"a": 5})
    assert changes == [({"a": 5, "b": 10}, 10)]
    some.add_pre_set(lambda values: {})
    # The other callback asks for `b`.
    assert some.change([Parameter("a", ParameterType.INTEGER, 1)]).successful
    with pytest.raises(TypeError, match="must return a dict of what is to be set, not None"):
        some.add_pre_set(lambda values: None)  # type: ignore[arg-type, return-value]
        some.set({"a": 6})


def test_callbacks_are_plain_functions() -> None:
    async def check(values: dict[str, Any]) -> None: ...

    some = parameters()
    for add in (some.add_pre_set, some.add_on_set, some.add_post_set):
        with pytest.raises(ConfigurationError, match="is async, and parameters are set without waiting"):
            add(check)  # type: ignore[arg-type]


def test_changes_are_told() -> None:
    changes: list[Change[Parameter]] = []
    some = ParameterSet("/robot", {}, None, changes.append)
    some.declare("a", 1, is_dynamic=True, description=Description("the a", "any"))
    some.declare("unset", type_=str)
    some.set({"a": 2, "unset": "x"})
    some.change([Parameter("a", ParameterType.NOT_SET, None)])
    names = [tuple([one.name for one in part] for part in change) for change in changes]
    assert names == [(["a"], [], []), (["unset"], ["a"], []), ([], [], ["a"])]

"""The parameters of a node: types, rules, callbacks; for both APIs, `bus.Node` and the facade of rclpy.

Owns: which values a node's parameters have, and ROS 2's rules for changing them, with its texts. Must not
know: messages, nodes, the bus, files and command lines, or how a program writes a parameter: all it
asks of one is `Setting`.

Callbacks and hooks run in the thread that makes the change; there is no lock, a step is one dict operation.
"""

import array
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from math import inf, isclose, isfinite
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

__all__ = [
    "NOTHING_TO_SET",
    "SEPARATOR",
    "UNDECLARED",
    "WRONG_TYPE",
    "Change",
    "Declared",
    "Outcome",
    "ParameterStore",
    "ParameterType",
    "Range",
    "Rules",
    "Setting",
]

SEPARATOR = "."
"""Between the parts of a parameter's name."""

UNDECLARED = "Invalid access to undeclared parameter(s)"
WRONG_TYPE = "Wrong parameter type"
"""What the reason begins with where a value has another type than was declared."""
NOTHING_TO_SET = (
    "parameter list cannot be empty, this might be due to pre_set_parameters_callback modifying the "
    "original parameters list."
)

_TOLERANCE = 1e-6


class ParameterType(IntEnum):
    """What a parameter holds; the numbers are those of rcl_interfaces/msg/ParameterType."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @classmethod
    def from_parameter_value(cls, parameter_value: Any) -> "ParameterType":
        """The type of a Python value; an empty list is a BYTE_ARRAY. Raises TypeError where it has none."""
        if parameter_value is None:
            return cls.NOT_SET
        for type_, python_type in _SCALARS.items():
            if isinstance(parameter_value, python_type):
                return type_
        if not isinstance(parameter_value, _SEQUENCES):
            raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")
        for type_, python_type in _ITEMS.items():
            if all(isinstance(item, python_type) for item in parameter_value):
                return type_
        raise TypeError(f"The given value is not a list of one of the allowed types '{parameter_value}'.")

    def check(self, parameter_value: Any) -> bool:
        """Whether a Python value is of this type."""
        if self is ParameterType.NOT_SET:
            return parameter_value is None
        if self in _SCALARS:
            return isinstance(parameter_value, _SCALARS[self])
        item_type = _ITEMS[self]
        return isinstance(parameter_value, _SEQUENCES) and all(
            isinstance(item, item_type) for item in parameter_value
        )

    @property
    def is_array(self) -> bool:
        return self in _ITEMS

    def __str__(self) -> str:
        return f"Type.{self.name}"

    def __repr__(self) -> str:
        return f"<{self}: {self.value}>"


# In the order in which they are tried: a bool is an int as well.
_SCALARS = {
    ParameterType.BOOL: bool,
    ParameterType.INTEGER: int,
    ParameterType.DOUBLE: float,
    ParameterType.STRING: str,
}
_ITEMS = {
    ParameterType.BYTE_ARRAY: bytes,
    ParameterType.BOOL_ARRAY: bool,
    ParameterType.INTEGER_ARRAY: int,
    ParameterType.DOUBLE_ARRAY: float,
    ParameterType.STRING_ARRAY: str,
}
_SEQUENCES = (list, tuple, array.array)


class Setting(Protocol):
    """A parameter as it is, or as it is to be; it doesn't change."""

    @property
    def name(self) -> str: ...

    @property
    def type_(self) -> ParameterType: ...

    @property
    def value(self) -> Any: ...


P = TypeVar("P", bound=Setting)


class Range(NamedTuple):
    """Both ends are in it, in any order; `step` 0 = every value between."""

    from_value: float
    to_value: float
    step: float = 0


class Rules(NamedTuple):
    """The rules that values must obey. The ranges are `Range` or the messages of them."""

    type_: ParameterType = ParameterType.NOT_SET
    is_dynamic: bool = False
    is_read_only: bool = False
    integer_range: Any = None
    floating_point_range: Any = None

    @classmethod
    def of(cls, descriptor: Any) -> "Rules":
        """Those in a rcl_interfaces/msg/ParameterDescriptor; None has none but that of the static type."""
        if descriptor is None:
            return cls()
        return cls(
            ParameterType(descriptor.type),
            descriptor.dynamic_typing,
            descriptor.read_only,
            next(iter(descriptor.integer_range), None),
            next(iter(descriptor.floating_point_range), None),
        )

    def with_type_of(self, one: Setting) -> "Rules":
        """The type is the one that the first value had, or the present one's where it may change."""
        is_fixed = not self.is_dynamic and one.type_ is ParameterType.NOT_SET
        return self if is_fixed else self._replace(type_=one.type_)

    def find_fault(self, one: Setting, *, is_known: bool) -> str:
        """Why the value is not allowed, "" where it is; `is_known`: the parameter was declared before."""
        type_ = one.type_
        if not self.is_dynamic:
            if type_ is ParameterType.NOT_SET:
                return "Static parameter cannot be undeclared" if is_known else ""
            if type_ is not self.type_:
                return f"{WRONG_TYPE}, expected '{self.type_}' got '{type_}'"
        if type_ is ParameterType.INTEGER and self.integer_range is not None:
            return _integer_fault(one, self.integer_range)
        if type_ is ParameterType.DOUBLE and self.floating_point_range is not None:
            return _float_fault(one, self.floating_point_range)
        return ""


class Declared(Generic[P]):
    """A parameter with its rules, and what its API keeps to describe it by."""

    __slots__ = ("description", "parameter", "rules")

    def __init__(self, parameter: P, rules: Rules, description: Any = None) -> None:
        self.parameter = parameter
        self.rules = rules
        self.description = description


class Change(NamedTuple, Generic[P]):
    """What one step did."""

    new: tuple[P, ...]
    changed: tuple[P, ...]
    deleted: tuple[P, ...]


class Outcome(NamedTuple):
    """Whether it was set, and if not, why; rclpy's SetParametersResult has the same fields."""

    successful: bool
    reason: str = ""


_OK = Outcome(True)


class ParameterStore(Generic[P]):
    """The parameters of one node.

    `pre_set`, `on_set` and `post_set` are the callbacks around a change, in the order of their calls. A
    pre-set one gets what is to be set and returns what to set instead; an on-set one returns an Outcome (or
    what has its fields); a post-set one gets what was set. `on_change` is called before the post-set ones.
    """

    def __init__(self, on_change: Callable[[Change[P]], object] | None = None) -> None:
        self.declared: dict[str, Declared[P]] = {}
        self.pre_set: list[Callable[[list[P]], Iterable[P]]] = []
        self.on_set: list[Callable[[list[P]], Any]] = []
        self.post_set: list[Callable[[list[P]], object]] = []
        self._on_change = on_change

    def prepare(self, wanted: list[P]) -> list[P]:
        """What the pre-set callbacks make of what is to be set."""
        if self.pre_set:
            return [one for callback in tuple(self.pre_set) for one in callback(list(wanted))]
        return wanted

    def unknown(self, wanted: Iterable[P]) -> list[str]:
        """Names of those that nobody declared."""
        return [one.name for one in wanted if one.name not in self.declared]

    def set(self, wanted: list[P]) -> Outcome:
        """Set all or none. One without a value is undeclared, one that is not declared gets any type."""
        return self._change(wanted) if wanted else Outcome(False, NOTHING_TO_SET)

    def declare(self, one: P, rules: Rules, description: Any = None) -> Outcome:
        """Declare one, or describe it anew; it may have no value yet."""
        return self._change([one], rules, description)

    def find_below(self, prefixes: Sequence[str], depth: int) -> tuple[list[str], list[str]]:
        """Names below any of `prefixes` (none = all), at most `depth` levels down (0 = all); and the prefixes
        of these names."""
        found = [name for name in tuple(self.declared) if _is_below(name, prefixes, depth)]
        above = (name.rpartition(SEPARATOR)[0] for name in found)
        return found, list(dict.fromkeys(filter(None, above)))

    # --- inside

    def _change(self, wanted: list[P], rules: Rules | None = None, description: Any = None) -> Outcome:
        """With `rules` this declares, or describes anew."""
        outcome = self._ask(wanted, rules)
        if not outcome.successful:
            return outcome
        change = self._store(wanted, rules, description)
        if self._on_change is not None and any(change):
            self._on_change(change)
        for after in tuple(self.post_set):
            after(wanted)
        return _OK

    def _ask(self, wanted: list[P], rules: Rules | None) -> Outcome:
        """Whether the rules allow it, and then the callbacks."""
        for one in wanted:
            if reason := self._fault(one, rules):
                return Outcome(False, reason)
        for callback in tuple(self.on_set):
            result = callback(wanted)
            if not hasattr(result, "successful"):
                raise TypeError(f"{callback!r} must return a SetParametersResult, not {result!r}")
            if not result.successful:
                return Outcome(False, result.reason)
        return _OK

    def _fault(self, one: P, rules: Rules | None) -> str:
        declared = self.declared.get(one.name)
        if rules is not None:
            return rules.find_fault(one, is_known=declared is not None)
        if declared is None:
            return ""
        if declared.rules.is_read_only:
            return f"Trying to set a read-only parameter: {one.name}."
        return declared.rules.find_fault(one, is_known=True)

    def _store(self, wanted: list[P], rules: Rules | None, description: Any) -> Change[P]:
        new: list[P] = []
        changed: list[P] = []
        deleted: list[P] = []
        for one in wanted:
            before = self.declared.get(one.name)
            if rules is None and one.type_ is ParameterType.NOT_SET:
                self.declared.pop(one.name, None)
                deleted.append(one)
                continue
            if rules is not None:
                self.declared[one.name] = Declared(one, rules.with_type_of(one), description)
            elif before is None:
                self.declared[one.name] = Declared(one, Rules(one.type_, is_dynamic=True))
            else:
                self.declared[one.name] = Declared(one, before.rules.with_type_of(one), before.description)
            if one.type_ is not ParameterType.NOT_SET:
                is_new = before is None or before.parameter.type_ is ParameterType.NOT_SET
                (new if is_new else changed).append(one)
        return Change(tuple(new), tuple(changed), tuple(deleted))


def _integer_fault(one: Setting, allowed: Any) -> str:
    value = one.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if value in (low, high):
        return ""
    if not low < value < high:
        return _out_of_range(one, low, high)
    if allowed.step and (value - low) % allowed.step:
        return (
            f"The parameter value for {one.name} is not a valid step. "
            f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
        )
    return ""


def _float_fault(one: Setting, allowed: Any) -> str:
    value = one.value
    low, high = sorted((allowed.from_value, allowed.to_value))
    if isclose(value, low, rel_tol=_TOLERANCE) or isclose(value, high, rel_tol=_TOLERANCE):
        return ""
    if not low < value < high:  # NaN too
        return _out_of_range(one, low, high)
    steps = (value - low) / allowed.step if allowed.step else inf
    if isfinite(steps):  # else there is no first step, or they are too small to be told apart
        nearest = low + round(steps) * allowed.step
        if not isclose(nearest, value, rel_tol=_TOLERANCE):
            return (
                f"The parameter value for {one.name} is not close enough to a valid step. "
                f"Min: {low}, max: {high}, value: {value}, step: {allowed.step}"
            )
    return ""


def _out_of_range(one: Setting, low: float, high: float) -> str:
    return f"Parameter {one.name} out of range. Min: {low}, Max: {high}, value: {one.value}"


def _is_below(name: str, prefixes: Sequence[str], depth: int) -> bool:
    def fits(rest: str) -> bool:
        return not depth or rest.count(SEPARATOR) < depth

    if not prefixes:
        return fits(name)
    return any(
        name == prefix or (name.startswith(prefix + SEPARATOR) and fits(name[len(prefix) + len(SEPARATOR) :]))
        for prefix in prefixes
    )

"""The parameters of one `bus.Node`, as plain Python values, with errors that name the fault.

Owns: the Python values for each type, the values of the command line, and the errors. Must not know:
messages, services, event loops. `bus.parameters.store` changes the values.
"""

import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from bus.base.callbacks import is_async
from bus.errors import CommandLineError, ConfigurationError, ParameterError
from bus.parameters.store import Change, Declared, Outcome, ParameterStore
from bus.parameters.values import SEPARATOR, UNDECLARED, ParameterType, Range, Rules
from bus.process.start_errors import shown_in_one_line

__all__ = ["Description", "OnSet", "Parameter", "ParameterSet", "PostSet", "PreSet", "Values"]

Values: TypeAlias = dict[str, Any]
"""Parameters by name; None = remove the parameter."""
PreSet: TypeAlias = Callable[[Values], Values]
OnSet: TypeAlias = Callable[[Values], str | None]
PostSet: TypeAlias = Callable[[Values], object]

_INT64: Final = range(-(2**63), 2**63)
_SHOWN: Final = 80
_TYPES: Final[dict[Any, ParameterType]] = {
    bool: ParameterType.BOOL,
    int: ParameterType.INTEGER,
    float: ParameterType.DOUBLE,
    str: ParameterType.STRING,
    bytes: ParameterType.BYTE_ARRAY,
    list[bool]: ParameterType.BOOL_ARRAY,
    list[int]: ParameterType.INTEGER_ARRAY,
    list[float]: ParameterType.DOUBLE_ARRAY,
    list[str]: ParameterType.STRING_ARRAY,
}
_ALLOWED: Final = "bool, int, float, str, bytes, or a list of bool, int, float or str"
_DOUBLES: Final = (ParameterType.DOUBLE, ParameterType.DOUBLE_ARRAY)


class Parameter(NamedTuple):
    """A present or requested parameter. A byte array is `bytes`, other arrays are lists."""

    name: str
    type_: ParameterType
    value: Any


class Description(NamedTuple):
    """Texts for people."""

    description: str = ""
    constraints: str = ""


class ParameterSet:
    """The parameters of the node with the full name `node`.

    `overrides` are the values of the command line by name. `provided` has the defaults of parameters that
    each node has by itself; a program may still declare these, with another default. `on_change` is called
    with each change. Raises CommandLineError for an invalid value of a provided parameter.
    """

    def __init__(
        self,
        node: str,
        overrides: Mapping[str, Any],
        provided: Mapping[str, Any] | None = None,
        on_change: Callable[[Change[Parameter]], object] | None = None,
    ) -> None:
        self._node = node
        self._overrides = overrides
        self._store: ParameterStore[Parameter] = ParameterStore(on_change)
        self._provided: set[str] = set()
        for name, default in (provided or {}).items():
            self.declare(name, default)
            self._provided.add(name)

    # --- declaring

    def declare(
        self,
        name: str,
        default: Any = None,
        *,
        type_: Any = None,
        description: Description = Description(),  # noqa: B008 - it doesn't change
        limits: Sequence[float] | None = None,
        is_read_only: bool = False,
        is_dynamic: bool = False,
    ) -> Any:
        """Declare a parameter; returns its value, None if it has none yet.

        Raises ParameterError, or CommandLineError if the value is from the command line.
        """
        if not isinstance(name, str) or not name:
            raise self._error(name, "a name is a text that is not empty")
        is_provided = name in self._provided
        if name in self._store.declared and not is_provided:
            raise self._error(name, "is declared already")
        wanted = self._type(name, type_, default, is_dynamic=is_dynamic)
        one = self._parameter(name, default, wanted)
        if one.type_ not in (wanted, ParameterType.NOT_SET) and not is_dynamic:
            raise self._error(name, f"the default {_shown(default)} is no {_word(wanted)}")
        rules = Rules(wanted, is_dynamic, is_read_only, **self._ranges(name, wanted, limits))
        # A default that breaks its own rules is the program's mistake, even if the command line has a valid
        # value.
        if reason := rules.find_fault(one, is_known=False):
            raise self._refused([one], reason)
        is_outside = name in self._overrides
        if is_outside:
            one = self._parameter(name, self._overrides[name], wanted, is_outside=True)
        outcome = self._store.declare(one, rules, description)
        if not outcome.successful:
            reason = outcome.reason
            if wanted is ParameterType.DOUBLE and one.type_ is ParameterType.INTEGER:
                reason += f"; write {float(one.value)}"
            with shown_in_one_line:
                raise self._refused([one], reason, is_outside=is_outside)
        self._provided.discard(name)
        return _copy(one.value)

    def undeclare(self, name: str) -> None:
        """Remove a parameter. Raises ParameterError if it is not declared, or read-only."""
        if self.find(name).rules.is_read_only:
            raise self._error(name, "is read-only")
        del self._store.declared[name]

    # --- reading

    def __contains__(self, name: str) -> bool:
        return name in self._store.declared

    def get(self, name: str) -> Any:
        """The value of a parameter. Raises ParameterError if it is not declared, or has no value yet."""
        declared = self.find(name)
        if declared.parameter.type_ is ParameterType.NOT_SET and not declared.rules.is_dynamic:
            raise self._error(name, f"has no value yet; give it one on the command line: -p {name}:=...")
        return _copy(declared.parameter.value)

    def below(self, prefix: str) -> Values:
        """Values of parameters below `prefix` and a dot, by the rest of the name; "" = of all parameters."""
        start = f"{prefix}{SEPARATOR}" if prefix else ""
        return {
            name[len(start) :]: _copy(declared.parameter.value)
            for name, declared in self._store.declared.items()
            if name.startswith(start) and declared.parameter.type_ is not ParameterType.NOT_SET
        }

    def find(self, name: str) -> Declared[Parameter]:
        """The parameter with its rules. Raises ParameterError if it is not declared."""
        declared = self._store.declared.get(name)
        if declared is None:
            from bus.base.suggest import did_you_mean

            near = did_you_mean(str(name), self._store.declared)
            raise self._error(name, f"is not declared{near}")
        return declared

    def find_below(self, prefixes: Sequence[str], depth: int) -> tuple[list[str], list[str]]:
        """As `ParameterStore.find_below`."""
        return self._store.find_below(prefixes, depth)

    # --- setting

    def set(self, values: Mapping[str, Any]) -> None:
        """Set all values or none. Raises ParameterError."""
        wanted = []
        for name, value in values.items():
            if value is None:
                raise self._error(name, "can't be None")
            wanted.append(self._parameter(name, value, _static_type(self.find(name))))
        if not wanted:
            return
        outcome = self.change(wanted)
        if not outcome.successful:
            raise self._refused(wanted, outcome.reason)

    def change(self, wanted: list[Parameter]) -> Outcome:
        """Set all values or none for another program: a mistake becomes an answer, not an error."""
        wanted = self._store.prepare(wanted)
        if unknown := self._store.unknown(wanted):
            return Outcome(False, f"{UNDECLARED}: {unknown}")
        return self._store.set(wanted)

    # --- callbacks

    def add_pre_set(self, callback: PreSet) -> None:
        """Add a pre-set callback. Raises ConfigurationError for an async function."""

        def prepare(wanted: list[Parameter]) -> Iterable[Parameter]:
            values = callback(_values(wanted))
            if not isinstance(values, dict):
                raise TypeError(f"{callback!r} must return a dict of what is to be set, not {values!r:.80}")
            return [self._made_of(name, value) for name, value in values.items()]

        self._add(self._store.pre_set, callback, prepare)

    def add_on_set(self, callback: OnSet) -> None:
        """Add an on-set callback. Raises ConfigurationError for an async function."""

        def check(wanted: list[Parameter]) -> Outcome:
            reason = callback(_values(wanted))
            if reason is not None and not isinstance(reason, str):
                raise TypeError(f"{callback!r} must return None, or why not as a str; not {reason!r:.80}")
            return Outcome(not reason, reason or "")

        self._add(self._store.on_set, callback, check)

    def add_post_set(self, callback: PostSet) -> None:
        """Add a post-set callback. Raises ConfigurationError for an async function."""
        self._add(self._store.post_set, callback, lambda done: callback(_values(done)))

    def remove(self, callback: Callable[..., object]) -> None:
        """Remove a callback. Raises ConfigurationError if it was not added."""
        lists: tuple[list[Any], ...] = (self._store.pre_set, self._store.on_set, self._store.post_set)
        for callbacks in lists:
            for one in callbacks:
                if one.original == callback:
                    callbacks.remove(one)
                    return
        raise ConfigurationError(f"{callback!r} is no callback for parameters of {self._node}")

    # --- inside

    def _add(self, callbacks: list[Any], original: Callable[..., object], call: Any) -> None:
        if is_async(original):
            raise ConfigurationError(
                f"{original!r} is async, and parameters are set without waiting: use a plain function, "
                "and asyncio.create_task for what takes time"
            )
        callbacks.insert(0, _Callback(original, call))

    def _made_of(self, name: str, value: Any) -> Parameter:
        """A parameter from the result of a pre-set callback; an unknown name becomes an answer to the
        caller."""
        return self._parameter(name, value, _static_type(self._store.declared.get(name)))

    def _type(self, name: str, type_: Any, default: Any, *, is_dynamic: bool) -> ParameterType:
        if type_ is not None:
            if is_dynamic:
                raise self._error(name, "has either a type or a dynamic one")
            found = _TYPES.get(type_)
            if found is None:
                raise self._error(name, f"no parameter has the type {type_!r:.80}; it is {_ALLOWED}")
            return found
        if default is None and not is_dynamic:
            raise self._error(name, "is declared without a default: say its type, as in type=float")
        if isinstance(default, list | tuple) and not default and not is_dynamic:
            raise self._error(name, "is declared as an empty list: say its type, as in type=list[float]")
        return self._parameter(name, default).type_

    def _parameter(
        self,
        name: str,
        value: Any,
        expected: ParameterType = ParameterType.NOT_SET,
        *,
        is_outside: bool = False,
    ) -> Parameter:
        """Make a parameter of a Python value.

        `expected` decides the type of an empty list, and whether an int becomes a double. Values from outside
        distinguish int and double, so an int from outside stays one.
        """
        if isinstance(value, bytes | bytearray):
            return Parameter(name, ParameterType.BYTE_ARRAY, bytes(value))
        if isinstance(value, tuple | array.array):
            value = list(value)
        if value == [] and expected.is_array:
            return Parameter(name, expected, b"" if expected is ParameterType.BYTE_ARRAY else [])
        if not is_outside and (expected in _DOUBLES or isinstance(value, list)):
            value = _with_doubles(value, expected)
        try:
            type_ = ParameterType.from_parameter_value(value)
            if type_ is ParameterType.INTEGER_ARRAY and bool in map(type, value):
                raise TypeError  # a bool is an int, but no message takes it for one
        except TypeError:
            raise self._error(name, f"can't be {_shown(value)}; a value is {_ALLOWED}") from None
        if type_ is ParameterType.BYTE_ARRAY:
            value = b"".join(value)
        elif isinstance(value, list):
            value = [_plain(item) for item in value]
        else:
            value = _plain(value)
        for number in value if type_ is ParameterType.INTEGER_ARRAY else (value,):
            if isinstance(number, int) and number not in _INT64:
                raise self._error(name, f"can't be {_shown(number)}: an integer has 64 bits")
        return Parameter(name, type_, value)

    def _ranges(self, name: str, type_: ParameterType, limits: Sequence[float] | None) -> dict[str, Range]:
        if limits is None:
            return {}
        kinds: dict[ParameterType, tuple[str, type]] = {
            ParameterType.INTEGER: ("integer_range", int),
            ParameterType.DOUBLE: ("floating_point_range", float),
        }
        if type_ not in kinds:
            raise self._error(name, f"is {_word(type_)} and can't have a range; only an int or a float can")
        field, kind = kinds[type_]
        allowed = (int,) if kind is int else (int, float)
        are_numbers = isinstance(limits, Sequence) and all(isinstance(one, allowed) for one in limits)
        if not are_numbers or len(limits) not in (2, 3):
            expected = f"(lowest, highest) or (lowest, highest, step), each {kind.__name__}"
            raise self._error(name, f"range={limits!r:.80} is not {expected}")
        low, high, step = (*map(kind, limits), kind())[:3]
        if not low <= high or not step >= 0:
            what = "a step is not below 0" if low <= high else "the lowest stands first"
            raise self._error(name, f"range={limits!r:.80}: {what}")
        if kind is int and not all(one in _INT64 for one in (low, high, step)):
            raise self._error(name, f"range={limits!r:.80}: an integer has 64 bits")
        return {field: Range(low, high, step)}

    def _refused(
        self,
        wanted: Sequence[Parameter],
        reason: str,
        *,
        is_outside: bool = False,
    ) -> ConfigurationError | ParameterError:
        if len(wanted) == 1:
            name, _, value = wanted[0]
            source = ", as the command line says" if is_outside else ""
            error = self._error(name, f"can't be {_shown(value)}{source}: {reason}")
            return CommandLineError(str(error)) if is_outside else error
        names = ", ".join(one.name for one in wanted)
        values = ", ".join(f"{one.name}={_shown(one.value)}" for one in wanted)
        return ParameterError(names, f"parameters of {self._node} can't be set to {values}: {reason}")

    def _error(self, name: str, text: str) -> ParameterError:
        return ParameterError(name, f"parameter '{name}' of {self._node}: {text}")


class _Callback:
    """A user's callback, and the function that calls it with plain values."""

    __slots__ = ("_call", "original")

    def __init__(self, original: Callable[..., object], call: Callable[[Any], Any]) -> None:
        self.original = original
        self._call = call

    def __call__(self, wanted: list[Parameter]) -> Any:
        return self._call(wanted)


def _static_type(declared: Declared[Parameter] | None) -> ParameterType:
    """The type that a value must have; NOT_SET if it may have any type."""
    if declared is None or declared.rules.is_dynamic:
        return ParameterType.NOT_SET
    return declared.rules.type_


def _values(some: Iterable[Parameter]) -> Values:
    return {one.name: _copy(one.value) for one in some}


def _copy(value: Any) -> Any:
    """A copy of a list: if a program changes its list, the parameter stays as it is."""
    return value.copy() if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    """A value of the plain type, instead of a subclass such as an enum."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int):
        return int(value)
    return float(value) if isinstance(value, float) else str.__str__(value)


def _with_doubles(value: Any, expected: ParameterType) -> Any:
    """Integers as doubles, if doubles are expected, or are in the same list."""
    if isinstance(value, list):
        kinds = {type(item) for item in value}
        if kinds == {int, float} or (kinds == {int} and expected is ParameterType.DOUBLE_ARRAY):
            return [float(item) for item in value]
        return value
    return float(value) if type(value) is int and expected is ParameterType.DOUBLE else value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _word(type_: ParameterType) -> str:
    """The type's name as written by ros2: 'integer array'."""
    return type_.name.lower().replace("_", " ")

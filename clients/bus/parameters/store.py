"""The parameters of a node, and their changes; for both APIs, `bus.Node` and the facade of rclpy.

Owns: the declared parameters with their values, and the steps of a change: rules, callbacks, hooks. Must not
know: messages, nodes, the bus, files and command lines, or a program's classes of parameters: it only uses
the protocol `Setting`.

Callbacks and hooks run in the thread that makes the change. There is no lock, because each step is one dict
operation.
"""

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, Generic, NamedTuple, TypeVar

from bus.parameters.values import SEPARATOR, ParameterType, Rules, Setting

__all__ = ["Change", "Declared", "Outcome", "ParameterStore"]

P = TypeVar("P", bound=Setting)

_INVALID_RESULT: Final = "Callback returned an invalid type"
_NOTHING_TO_SET: Final = (
    "parameter list cannot be empty, this might be due to pre_set_parameters_callback modifying the "
    "original parameters list."
)


class Declared(Generic[P]):
    """A parameter with its rules, and a description that belongs to its API."""

    __slots__ = ("description", "parameter", "rules")

    def __init__(self, parameter: P, rules: Rules, description: Any = None) -> None:
        self.parameter = parameter
        self.rules = rules
        self.description = description


class Change(NamedTuple, Generic[P]):
    """The effect of one step."""

    new: tuple[P, ...]
    changed: tuple[P, ...]
    deleted: tuple[P, ...]


class Outcome(NamedTuple):
    """Whether a parameter was set, or the reason; rclpy's SetParametersResult has the same fields."""

    successful: bool
    reason: str = ""


_OK = Outcome(True)


class ParameterStore(Generic[P]):
    """The parameters of one node.

    `pre_set`, `on_set` and `post_set` are the callbacks around a change, in the order of their calls. A
    pre-set callback gets the requested parameters and returns those to set instead. An on-set callback
    returns an Outcome (or an object with its fields). A post-set callback gets the parameters that were set.
    `on_change` is called before the post-set callbacks.
    """

    def __init__(self, on_change: Callable[[Change[P]], object] | None = None) -> None:
        self.declared: dict[str, Declared[P]] = {}
        self.pre_set: list[Callable[[list[P]], Iterable[P]]] = []
        self.on_set: list[Callable[[list[P]], Any]] = []
        self.post_set: list[Callable[[list[P]], object]] = []
        self._on_change = on_change

    def prepare(self, wanted: list[P]) -> list[P]:
        """The parameters to set, after the pre-set callbacks."""
        if self.pre_set:
            return [one for callback in tuple(self.pre_set) for one in callback(list(wanted))]
        return wanted

    def unknown(self, wanted: Iterable[P]) -> list[str]:
        """Names of parameters that are not declared."""
        return [one.name for one in wanted if one.name not in self.declared]

    def set(self, wanted: list[P]) -> Outcome:
        """Set all or none. A parameter without a value is removed; an undeclared one may have any type."""
        return self._change(wanted) if wanted else Outcome(False, _NOTHING_TO_SET)

    def declare(self, one: P, rules: Rules, description: Any = None) -> Outcome:
        """Declare a parameter, or change its description; it may have no value yet."""
        return self._change([one], rules, description)

    def find_below(self, prefixes: Sequence[str], depth: int) -> tuple[list[str], list[str]]:
        """Names below any of `prefixes` (none = all), at most `depth` levels down (0 = all), and their
        prefixes."""
        found = [name for name in tuple(self.declared) if _is_below(name, prefixes, depth)]
        above = (name.rpartition(SEPARATOR)[0] for name in found)
        return found, list(dict.fromkeys(filter(None, above)))

    # --- inside

    def _change(self, wanted: list[P], rules: Rules | None = None, description: Any = None) -> Outcome:
        """Change parameters; with `rules`, declare them or change their descriptions."""
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
        """Whether the rules, and then the callbacks, allow a change."""
        for one in wanted:
            if reason := self._fault(one, rules):
                return Outcome(False, reason)
        for callback in tuple(self.on_set):
            result = callback(wanted)
            if not hasattr(result, "successful"):
                warnings.warn(f"{callback!r} must return a SetParametersResult, not {result!r}", stacklevel=6)
                return Outcome(False, _INVALID_RESULT)
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


def _is_below(name: str, prefixes: Sequence[str], depth: int) -> bool:
    def fits(rest: str) -> bool:
        return not depth or rest.count(SEPARATOR) < depth

    if not prefixes:
        return fits(name)
    return any(
        name == prefix or (name.startswith(prefix + SEPARATOR) and fits(name[len(prefix) + len(SEPARATOR) :]))
        for prefix in prefixes
    )

"""The parameters that a node has, and how they change; for both APIs, `bus.Node` and the facade of rclpy.

Owns: what is declared with which value, and the steps of a change: rules, callbacks, hooks. Must not know:
messages, nodes, the bus, files and command lines, or how a program writes a parameter: all it asks of
one is `Setting`.

Callbacks and hooks run in the thread that makes the change; there is no lock, a step is one dict operation.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, Generic, NamedTuple, TypeVar

from bus.parameters.values import SEPARATOR, ParameterType, Rules, Setting

__all__ = ["Change", "Declared", "Outcome", "ParameterStore"]

P = TypeVar("P", bound=Setting)

_NOTHING_TO_SET: Final = (
    "parameter list cannot be empty, this might be due to pre_set_parameters_callback modifying the "
    "original parameters list."
)


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
        """Names of parameters that are not declared."""
        return [one.name for one in wanted if one.name not in self.declared]

    def set(self, wanted: list[P]) -> Outcome:
        """Set all or none. One without a value is undeclared, one that is not declared gets any type."""
        return self._change(wanted) if wanted else Outcome(False, _NOTHING_TO_SET)

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


def _is_below(name: str, prefixes: Sequence[str], depth: int) -> bool:
    def fits(rest: str) -> bool:
        return not depth or rest.count(SEPARATOR) < depth

    if not prefixes:
        return fits(name)
    return any(
        name == prefix or (name.startswith(prefix + SEPARATOR) and fits(name[len(prefix) + len(SEPARATOR) :]))
        for prefix in prefixes
    )

"""The classes that make actions of tags, and substitutions of `$(name ...)`."""

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeVar

from bus_launch.launch.core import Substitution
from bus_launch.launch.frontend.entity import Entity

__all__ = [
    "expose_action",
    "expose_description",
    "expose_substitution",
    "instantiate_action",
    "instantiate_description",
    "instantiate_substitution",
]

_T = TypeVar("_T")
_Parse = Callable[..., tuple[Callable[..., Any], dict[str, Any]]]

_actions: Final[dict[str, _Parse]] = {}
_substitutions: Final[dict[str, _Parse]] = {}
_descriptions: Final[list[Callable[..., Any]]] = []


def expose_action(name: str) -> Callable[[_T], _T]:
    """Decorates a class with `parse(entity, parser)`, or such a function: it makes the actions of a tag."""
    return _exposer(name, _actions, "action")


def expose_substitution(name: str) -> Callable[[_T], _T]:
    """Decorates a class with `parse(arguments)`, or such a function: it makes `$(name arguments)`."""
    return _exposer(name, _substitutions, "substitution")


def expose_description(made: type[_T]) -> type[_T]:
    """Decorates the class of objects made from a whole file."""
    _descriptions.append(made)
    return made


def instantiate_description(actions: list[Any], deprecated_reason: str | None) -> Any:
    return _descriptions[0](actions, deprecated_reason=deprecated_reason)


def instantiate_action(entity: Entity, parser: object) -> Any:
    """Raises RuntimeError for an unknown tag, ValueError for an unknown attribute of it."""
    parse = _actions.get(entity.type_name)
    if parse is None:
        from bus.base.suggest import did_you_mean

        near = did_you_mean(entity.type_name, _actions)
        raise RuntimeError(f"Unrecognized entity of the type: {entity.type_name}{near}")
    made, arguments = parse(entity, parser)
    entity.assert_entity_completely_parsed()
    return made(**arguments)


def instantiate_substitution(
    type_name: str, args: Iterable[list[Substitution]] | None = None
) -> Substitution:
    """Raises RuntimeError for an unknown name."""
    parse = _substitutions.get(type_name)
    if parse is None:
        from bus.base.suggest import did_you_mean

        near = did_you_mean(type_name, _substitutions)
        raise RuntimeError(f"Unknown substitution: {type_name}{near}")
    made, arguments = parse(list(args or ()))
    found: Substitution = made(**arguments)
    return found


def _exposer(name: str, table: dict[str, _Parse], what: str) -> Callable[[_T], _T]:
    def expose(made: _T) -> _T:
        parse: Any = getattr(made, "parse", None) if isinstance(made, type) else made
        if not callable(parse):
            raise RuntimeError("Did not find a class method called 'parse' in the class being decorated.")
        if name in table and table[name] != parse:
            raise RuntimeError(f"Two {what} parsing methods exposed with the same name: [{name}].")
        table[name] = parse
        return made

    return expose

"""An element of a launch file in a markup language, and the types of its attributes."""

from collections.abc import Iterable
from typing import Any, List  # noqa: UP035 (the genuine one's `data_type`)

__all__ = ["Entity", "coerce", "is_list_of_entities", "name_of", "refuse_unknown"]


class Entity:
    """An element as its tag's parse function reads it: its attributes and the elements in it."""

    @property
    def type_name(self) -> str:
        raise NotImplementedError

    @property
    def parent(self) -> "Entity | None":
        raise NotImplementedError

    @property
    def children(self) -> "list[Entity]":
        """All elements in it."""
        raise NotImplementedError

    def get_attr(
        self,
        name: str,
        *,
        data_type: Any = str,
        optional: bool = False,
        can_be_str: bool = True,
    ) -> Any:
        """An attribute as `data_type`: a scalar's type, `List[...]` of one, `List[Entity]`, or None for any.

        A missing attribute: None if it is `optional`, else AttributeError. With `can_be_str`, text that does
        not fit stays text, for it may hold substitutions; else it raises TypeError.
        """
        raise NotImplementedError

    def assert_entity_completely_parsed(self) -> None:
        """Raise ValueError if there are attributes or elements that no action has read."""
        raise NotImplementedError


def is_list_of_entities(data_type: Any) -> bool:
    arguments: tuple[Any, ...] = getattr(data_type, "__args__", ())
    return [isinstance(one, type) and issubclass(one, Entity) for one in arguments] == [True]


def name_of(data_type: Any) -> str:
    """The element's name in messages."""
    if data_type is None:
        return "a scalar or a list of scalars"
    return data_type.__name__ if isinstance(data_type, type) else str(data_type)


def coerce(value: Any, data_type: Any, can_be_str: bool) -> Any:
    """Convert a text, or YAML's value of it, to the type; raises ValueError if that is not possible."""
    if data_type is None:
        return _by_yaml(value) if isinstance(value, str) else value
    if data_type in (int, float, bool, str):
        return _scalar(value, data_type, can_be_str)
    if getattr(data_type, "__origin__", None) in (list, List):  # noqa: UP006
        (kind,) = data_type.__args__
        values = _by_yaml(value) if isinstance(value, str) else value
        if not isinstance(values, list):
            raise ValueError(f"'{value}' is no list")
        return [_scalar(one, kind, can_be_str) for one in values]
    raise ValueError(f"Unrecognized data type: {data_type}")


def _scalar(value: Any, kind: type, can_be_str: bool) -> Any:
    made = _converted(value, kind)
    if made is not None:
        return made
    if can_be_str and isinstance(value, str):
        return value
    raise ValueError(f"'{value}' is no {kind.__name__}")


def _converted(value: Any, kind: type) -> Any:
    if not isinstance(value, str):
        fits = type(value) is kind or (kind is float and type(value) is int)
        return kind(value) if fits else None
    if kind is str:
        return value
    if kind is bool:
        found = _by_yaml(value)
        return found if isinstance(found, bool) else None
    try:
        return kind(value)
    except ValueError:
        return None


def _by_yaml(text: str) -> Any:
    from bus_launch.launch.yaml_values import load

    return load(text)


def refuse_unknown(what: str, unknown: Iterable[str], tag: str, known: Iterable[str]) -> None:
    """`what` were never read: raise ValueError with their names, and with the likely meaning of the first."""
    names = sorted(unknown)
    if names:
        listed = "{" + ", ".join(f"'{name}'" for name in names) + "}"
        from bus.base.suggest import did_you_mean

        near = did_you_mean(names[0], known)
        raise ValueError(f"Unexpected {what} found in `{tag}`: {listed}{near}")

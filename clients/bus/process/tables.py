"""Reads tables of busd.toml: checks their keys, and the types and ranges of values.

Owns the reading of a file, and the texts of errors with their places. Must not know the purpose of a table.
Slow to import, and needed by few programs: import it late.
"""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import msgspec
from msgspec import structs

from bus.errors import ConfigurationError
from bus.topic_patterns import shown

__all__ = ["check_keys", "checked", "each_of", "filled", "read_file"]

S = TypeVar("S", bound=msgspec.Struct)


def read_file(path: Path) -> dict[str, Any]:
    """The content of the file. Raises ConfigurationError, naming it, if it is missing or no TOML."""
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise ConfigurationError(f"{path}: can't be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: not valid TOML: {error}") from None


def filled(name: str, table: object, kind: type[S]) -> S:
    """`table` as a `kind`; `name` is the table's name in texts.

    Raises ConfigurationError, naming the key, for an unknown or missing key, and for a bad value.
    """
    fields = {field.name: field for field in structs.fields(kind)}
    entries = check_keys(f"{name}.", table, {key: key for key in fields})
    for key, field in fields.items():
        if field.required and key not in entries:
            raise ConfigurationError(f"{name}: '{key}' is missing")
    values: dict[str, Any] = {
        key: checked(f"{name}.{key}", value, fields[key].type) for key, value in entries.items()
    }
    return kind(**values)


def each_of(name: str, array: object) -> Iterator[tuple[str, object]]:
    """Each table of an array, with its name in texts: `topics[0]`."""
    if not isinstance(array, list):
        raise ConfigurationError(f"{name}: expected an array of tables, each under [[{name}]]")
    for at, table in enumerate(array):
        yield f"{name}[{at}]", table


def check_keys(
    where: str,
    table: object,
    known: Mapping[str, str],
    *,
    elsewhere: Mapping[str, str] | None = None,
) -> Mapping[str, Any]:
    """Return `table`, after a check that it is a table, and that all its keys are `known`.

    `where` comes before the key in texts: "", or the table's name and a dot. `elsewhere` has keys known in
    another table.
    """
    if not isinstance(table, dict):
        raise ConfigurationError(f"{where.removesuffix('.')}: expected a table, got {table!r}")
    for key in table:
        if key not in known:
            hint = _hint(key, {**(elsewhere or {}), **known})
            raise ConfigurationError(f"unknown key '{where}{key}'{hint}")
    return table


def checked(key: str, value: object, kind: Any) -> Any:
    """`value` as the type `kind`, within the range of its annotation.

    Raises ConfigurationError that names the key, the value and the expected type or range.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        text = str(error).replace(" | null", "")
        if isinstance(value, str) and (choices := _choices(kind)):
            text = f"expected one of {', '.join(choices)}"
        raise ConfigurationError(f"{key} = {shown(value)}: {text[0].lower()}{text[1:]}") from None


def _choices(kind: Any) -> list[str]:
    """The texts that a Literal allows, even if None is allowed, too."""
    parts = get_args(kind)
    if get_origin(kind) is Literal:
        return list(parts)
    return [choice for part in parts for choice in _choices(part)]


def _hint(key: str, known: Mapping[str, str]) -> str:
    from bus.base.suggest import nearest

    near = nearest(key.lower(), known)
    return f"; did you mean '{known[near]}'?" if near else f" (known: {', '.join(known.values())})"

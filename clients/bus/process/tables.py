"""Tables of busd.toml, for whoever reads one: which keys there are, values of the right type and range.

Owns reading a file and the texts that say what is wrong where. Must not know what a table is for. Slow to
import, and needed by few programs: import it late.
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
    """What stands in the file. Raises ConfigurationError, naming it, where it is not there or no TOML."""
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise ConfigurationError(f"{path}: can't be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: not valid TOML: {error}") from None


def filled(name: str, table: object, kind: type[S]) -> S:
    """`table`, which `name` stands for in texts, as a `kind`.

    Raises ConfigurationError, naming the key, for one that is unknown or missing, and for a bad value.
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
    """Each of an array of tables, with what it is called in texts: `topics[0]`."""
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
    """`table`. Refuses what is none, and the first key that is not `known`.

    `where` comes before the key in texts: "", or the table's name and a dot. `elsewhere` are keys known in
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
    """`value` as the type `kind`, with the range that its annotation sets.

    Raises ConfigurationError that names the key, the value and what was expected.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        text = str(error).replace(" | null", "")
        if isinstance(value, str) and (choices := _choices(kind)):
            text = f"expected one of {', '.join(choices)}"
        raise ConfigurationError(f"{key} = {shown(value)}: {text[0].lower()}{text[1:]}") from None


def _choices(kind: Any) -> list[str]:
    """The texts that a Literal allows, also where None is allowed besides."""
    parts = get_args(kind)
    if get_origin(kind) is Literal:
        return list(parts)
    return [choice for part in parts for choice in _choices(part)]


def _hint(key: str, known: Mapping[str, str]) -> str:
    from bus.base.suggest import nearest

    near = nearest(key.lower(), known)
    return f"; did you mean '{known[near]}'?" if near else f" (known: {', '.join(known.values())})"

"""The daemon's configuration file: TOML in, one frozen Config out.

Owns reading and the texts that say what is wrong where. Must not know what the values do: limits and topic
rules belong to busd.core.limits, users and groups to busd.config.access.
"""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import structs

from bus.errors import ConfigurationError
from busd.config.access import AccessTable, SocketTable
from busd.core.access import AccessRule
from busd.core.limits import Limits, TopicRule, checked
from busd.process.logs import LOG_FORMATS, LOG_LEVELS

__all__ = ["Config", "load"]

_Table = TypeVar("_Table", Limits, TopicRule, SocketTable, AccessTable)


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that busd.toml can set.

    Raises ConfigurationError for a log level or format that does not exist, and for a cap above the limit
    that it caps.
    """

    log_level: str = "info"
    """Least severe level that the daemon logs, one of LOG_LEVELS."""
    log_format: str = "text"
    """How a line of the log looks, one of LOG_FORMATS."""
    limits: Limits = Limits()
    """What each process may make busd hold."""
    topics: tuple[TopicRule, ...] = ()
    """Caps by topic name."""
    socket: SocketTable = SocketTable()
    """The users that can reach the socket at all."""
    access: tuple[AccessRule, ...] = ()
    """What users other than the daemon's own and root may do; the first that matches decides."""

    def __post_init__(self) -> None:
        for key, known in (("log_level", LOG_LEVELS), ("log_format", LOG_FORMATS)):
            if (value := getattr(self, key)) not in known:
                raise ConfigurationError(f"{key} = {value!r}: expected one of {', '.join(known)}")
        for at, rule in enumerate(self.topics):
            for cap, limit in (("max_depth", "depth"), ("max_message_bytes", "message_bytes")):
                value, most = getattr(rule, cap), getattr(self.limits, limit)
                if value is not None and value > most:
                    raise ConfigurationError(f"topics[{at}].{cap} = {value} is above limits.{limit} = {most}")


def load(path: Path) -> Config:
    """The configuration in the file at `path`; what it leaves out has its default.

    Raises ConfigurationError, naming the file and the key or line, for everything that is wrong with it.
    """
    try:
        with path.open("rb") as file:
            return _config(tomllib.load(file))
    except OSError as error:
        raise ConfigurationError(f"{path}: can't be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: not valid TOML: {error}") from None
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


def _config(content: Mapping[str, object]) -> Config:
    places = {name: f"limits.{name}" for name in Limits.__struct_fields__}
    _check_keys("", content, {name: name for name in Config.__struct_fields__}, elsewhere=places)
    return Config(
        log_level=checked("log_level", content.get("log_level", "info"), str),
        log_format=checked("log_format", content.get("log_format", "text"), str),
        limits=_table("limits", content.get("limits", {}), Limits),
        topics=tuple(_table(key, rule, TopicRule) for key, rule in _rules("topics", content)),
        socket=_table("socket", content.get("socket", {}), SocketTable),
        access=tuple(_table(key, rule, AccessTable).rule(key) for key, rule in _rules("access", content)),
    )


def _rules(name: str, content: Mapping[str, object]) -> Iterator[tuple[str, object]]:
    """Each of an array of tables, with what it is called in an error's text."""
    rules = content.get(name, [])
    if not isinstance(rules, list):
        raise ConfigurationError(f"{name}: expected an array of tables, each under [[{name}]]")
    for at, rule in enumerate(rules):
        yield f"{name}[{at}]", rule


def _table(name: str, table: object, kind: type[_Table]) -> _Table:
    if not isinstance(table, dict):
        raise ConfigurationError(f"{name}: expected a table, got {table!r}")
    fields = {field.name: field for field in structs.fields(kind)}
    _check_keys(f"{name}.", table, {key: key for key in fields})
    for key, field in fields.items():
        if field.required and key not in table:
            raise ConfigurationError(f"{name}: '{key}' is missing")
    values: dict[str, Any] = {
        key: checked(f"{name}.{key}", value, fields[key].type) for key, value in table.items()
    }
    return kind(**values)


def _check_keys(
    where: str,
    table: Mapping[str, object],
    known: Mapping[str, str],
    *,
    elsewhere: Mapping[str, str] | None = None,
) -> None:
    """Refuse the first key of `table` that is not `known`; `elsewhere` are keys known in another table."""
    for key in table:
        if key not in known:
            raise ConfigurationError(
                f"unknown key '{where}{key}'{_hint(key, {**(elsewhere or {}), **known})}"
            )


def _hint(key: str, known: Mapping[str, str]) -> str:
    from bus.base.suggest import nearest

    near = nearest(key.lower(), known)
    return f"; did you mean '{known[near]}'?" if near else f" (known: {', '.join(known.values())})"

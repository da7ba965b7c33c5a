"""`[bridge.zenoh]` and `[bridge.ros2]` of busd.toml, with the options of the command line."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import structs

from bus.errors import BusError, ConfigurationError
from bus.process.tables import check_keys, each_of, filled, read_file
from bus.topic_patterns import compiled
from bus_bridge.core.naming import Naming
from bus_bridge.core.qos_rule import QosRule
from bus_bridge.core.rules import TopicRule
from bus_bridge.dds.options import checked_interface, checked_peer, parse_server
from bus_bridge.labels import checked_group, checked_id
from bus_bridge.options import BridgeTable, Ros2Table, TlsTable, ZenohTable
from bus_bridge.zenoh.options import parse_address

__all__ = ["TABLES", "check_values", "load", "merged"]

T = TypeVar("T", bound=BridgeTable)

TABLES: Mapping[str, type[BridgeTable]] = {"zenoh": ZenohTable, "ros2": Ros2Table}
"""Classes of tables, by the name of the engine that users see."""

_CHECKS: Mapping[str, Callable[[str], object]] = {
    "id": checked_id,
    "namespace": Naming,
    "interface": checked_interface,
    "peers": checked_peer,
    "discovery_servers": parse_server,
    "listen": parse_address,
    "connect": parse_address,
    "router": parse_address,
    "group": checked_group,
    "see": checked_group,
}
"""Check functions for texts, by key. They apply to each table that has the key."""


def load(path: Path, kind: type[T]) -> T:
    """Read the file's settings for bridges of one kind, with defaults for missing ones.

    Raises ConfigurationError, which names the file and the key, for every fault in the table. busd owns the
    rest of the file, so this function does not check it.
    """
    content = read_file(path)
    try:
        bridges = check_keys("bridge.", content.get("bridge", {}), {name: name for name in TABLES})
        (name,) = (name for name, one in TABLES.items() if one is kind)
        table = _table(f"bridge.{name}", bridges.get(name, {}), kind, path.parent)
        check_values(table, lambda key: f"bridge.{name}.{key}")
        return table
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


def check_values(table: BridgeTable, called: Callable[[str], str]) -> None:
    """Check each text separately: ids, names, addresses, patterns. `called` returns the users' name of a key.

    Raises ConfigurationError, which names the key.
    """
    for key, check in _CHECKS.items():
        said = getattr(table, key, None)
        for text in said if isinstance(said, tuple) else (said,):
            try:
                if text is not None:
                    check(text)
            except BusError as error:
                raise ConfigurationError(f"{called(key)}: {error}") from None
    patterns = [("allow", one) for one in table.allow] + [("deny", one) for one in table.deny]
    patterns += [(f"topics[{at}].pattern", one.pattern) for at, one in enumerate(table.topics)]
    for key, pattern in patterns:
        compiled(pattern, called(key))


def merged(file: T, flags: T) -> T:
    """Join two settings: `flags` replace values of `file`, and extend options that may occur several
    times."""
    merged: T = _both(file, flags)
    return merged


def _both(ours: Any, theirs: Any) -> Any:
    match ours:
        case tuple():
            return (*ours, *(one for one in theirs if one not in ours))
        case msgspec.Struct():
            pairs = zip(structs.astuple(ours), structs.astuple(theirs), strict=True)
            return type(ours)(
                **dict(zip(ours.__struct_fields__, (_both(*pair) for pair in pairs), strict=True))
            )
        case _:
            return ours if theirs is None else theirs


def _table(name: str, table: object, kind: type[T], folder: Path) -> T:
    """Convert a table. It converts inner tables first: then errors name the inner key."""
    fields = {field.name: field for field in structs.fields(kind)}
    entries = dict(check_keys(f"{name}.", table, {key: key for key in fields}))
    topics, tls = entries.pop("topics", []), entries.pop("tls", {})
    for key, value in entries.items():
        if isinstance(value, str) and fields[key].default == ():
            entries[key] = [value]
    changes: dict[str, Any] = {
        "topics": tuple(_rule(key, one) for key, one in each_of(f"{name}.topics", topics))
    }
    if "tls" in fields:
        paths = structs.asdict(filled(f"{name}.tls", tls, TlsTable))
        changes["tls"] = TlsTable(**{key: value and str(folder / value) for key, value in paths.items()})
    return structs.replace(filled(name, entries, kind), **changes)


def _rule(name: str, table: object) -> TopicRule:
    """One rule. It converts the inner tables first: then errors name the inner key."""
    if isinstance(table, dict):
        ends = {end: table[end] for end in ("publisher", "subscription") if end in table}
        table = table | {end: filled(f"{name}.{end}", one, QosRule) for end, one in ends.items()}
    return filled(name, table, TopicRule)

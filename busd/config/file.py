"""The daemon's configuration file: TOML in, one frozen Config out.

Owns reading and the texts that say what is wrong where. Must not know what the values do: limits and topic
rules belong to busd.core.limits, users and groups to busd.config.access.
"""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from bus.errors import ConfigurationError
from bus.process.tables import check_keys, checked, each_of, filled, read_file
from busd.config.access import AccessTable, SocketTable
from busd.core.access import AccessRule
from busd.core.limits import Limits, TopicRule
from busd.process.logs import LOG_FORMATS, LOG_LEVELS

__all__ = ["BridgeTables", "Config", "load"]


class BridgeTables(msgspec.Struct, frozen=True):
    """`[bridge]`, which bridges read when they start or reload: busd only sees whether it has changed."""

    content: object = None

    def change(self, place: str, after: "BridgeTables") -> str:
        """Text for the log if this table, called `place`, has become `after`."""
        old, new = (one.content if isinstance(one.content, dict) else {} for one in (self, after))
        tables = [f"{place}.{name}" for name in old | new if old.get(name) != new.get(name)]
        return f"{', '.join(tables) or place}: changed; a bridge reads it when it starts or reloads"


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
    """Limits of the resources that each process may make busd hold."""
    topics: tuple[TopicRule, ...] = ()
    """Caps by topic name."""
    socket: SocketTable = SocketTable()
    """The users that can reach the socket at all."""
    access: tuple[AccessRule, ...] = ()
    """Rules for users other than the daemon's own and root; the first that matches decides."""
    bridge: BridgeTables = BridgeTables()
    """The tables that bridges read, and busd does not."""

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
    """The configuration in the file at `path`; missing keys have their defaults.

    Raises ConfigurationError, naming the file and the key or line, for everything that is wrong with it.
    """
    content = read_file(path)
    try:
        return _config(content)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


def _config(content: Mapping[str, object]) -> Config:
    places = {name: f"limits.{name}" for name in Limits.__struct_fields__}
    known = {name: name for name in Config.__struct_fields__}
    check_keys("", content, known, elsewhere=places)
    return Config(
        log_level=checked("log_level", content.get("log_level", "info"), str),
        log_format=checked("log_format", content.get("log_format", "text"), str),
        limits=filled("limits", content.get("limits", {}), Limits),
        topics=tuple(
            filled(key, rule, TopicRule) for key, rule in each_of("topics", content.get("topics", []))
        ),
        socket=filled("socket", content.get("socket", {}), SocketTable),
        access=tuple(
            filled(key, rule, AccessTable).rule(key)
            for key, rule in each_of("access", content.get("access", []))
        ),
        bridge=BridgeTables(content.get("bridge")),
    )

"""SIGHUP: a running bridge reads its file again and applies the rules. If something is wrong, the old rules
stay in force.

Owns the settings in force, and the meaning of SIGHUP to a bridge that was started in a terminal. Must not
know what the rules do.
"""

import asyncio
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from msgspec import structs

from bus.errors import BusError
from bus.logger import Logger
from bus.process.terminal import ends_with_terminal, has_terminal
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from bus_bridge.options import BridgeTable

__all__ = ["Reloading", "Source", "rules_of"]

_RULES: Final = ("allow", "deny", "topics")
"""Keys that apply to a running bridge."""


class Source(NamedTuple):
    """The file with the settings."""

    path: Path
    load: Callable[[], BridgeTable]
    """Returns the file's settings with the options of the command line. Raises BusError."""


def rules_of(engine: str, table: BridgeTable) -> tuple[Rules, Naming]:
    """The rules and the names of a bridge. Raises ConfigurationError."""
    rules = Rules(table.allow, table.deny, table.topics, table=f"bridge.{engine}")
    return rules, Naming(table.namespace or "", rules.far_names)


class Reloading:
    """`table` is in force. `apply` is called with other rules and names; `source` is None without a file."""

    def __init__(
        self,
        engine: str,
        table: BridgeTable,
        source: Source | None,
        apply: Callable[[Rules, Naming], object],
        log: Logger,
    ) -> None:
        self._engine = engine
        self._table = table
        self._source = source
        self._apply = apply
        self._log = log

    def reload(self) -> None:
        """Read the file again and apply the rules. The log has the changes, or the mistake, in one line."""
        if self._source is None:
            self._log.error("SIGHUP has no effect: the bridge has no file, only options. Give --config FILE")
            return
        try:
            found = self._source.load()
            later = _changed(self._table, found, but=_RULES)
            table = structs.replace(self._table, **{key: getattr(found, key) for key in _RULES})
            changes = _changed(self._table, table)
            if changes:
                self._apply(*rules_of(self._engine, table))
        except BusError as error:
            text = " ".join(line.strip() for line in str(error).splitlines())
            self._log.error(f"the rules stay as they were: {text}")
            return
        self._table = table
        said = f"changed: {', '.join(changes)}" if changes else "no rule has changed"
        if later:
            said += f"; changes of {', '.join(later)} apply when the bridge starts again"
        self._log.info(f"reloaded {self._source.path}: {said}")

    @contextmanager
    def at_hangup(self) -> Iterator[None]:
        """Reload at each SIGHUP. The end of the terminal ends the bridge, as SIGTERM does."""
        loop = asyncio.get_running_loop()
        does_end = ends_with_terminal()

        def on_hangup() -> None:
            if does_end and not has_terminal():
                signal.raise_signal(signal.SIGTERM)
            else:
                self.reload()

        loop.add_signal_handler(signal.SIGHUP, on_hangup)
        try:
            yield
        finally:
            loop.remove_signal_handler(signal.SIGHUP)


def _changed(old: BridgeTable, new: BridgeTable, but: tuple[str, ...] = ()) -> list[str]:
    """Keys with different values."""
    return [key for key in old.__struct_fields__ if key not in but and getattr(old, key) != getattr(new, key)]

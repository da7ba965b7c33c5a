"""SIGHUP: busd reads the configuration again and applies it. If something is wrong, the old one stays in
force.

Owns the configuration in force, and the log's words for a change of it. Must not know what the values do.
"""

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic_ns
from typing import Any

import msgspec

from bus.errors import ConfigurationError
from busd.config.file import BridgeTables, Config, load
from busd.process.repetitions import Repetitions
from busd.process.sd_notify import READY, notify, reloading

__all__ = ["Reloader"]

_LONGEST_VALUE = 60

_log = logging.getLogger("busd")


class Reloader:
    """`path` is the file that `config` came from, or None. `apply` applies a configuration."""

    def __init__(self, path: Path | None, config: Config, apply: Callable[[Config], None]) -> None:
        self.config = config
        """The configuration in force."""
        self._path = path
        self._answers = Repetitions()
        self._apply = apply

    def reload(self, *, is_asked: bool = False) -> str:
        """Read the file again; returns the changes, which the log has, too.

        `is_asked`: a program asked for it and gets the outcome as an answer; the log need not repeat it.
        Raises ConfigurationError, and logs it, if something is wrong; then all stays as it was.
        """
        log = self._answers.log if is_asked else _log.log
        notify(reloading(monotonic_ns()))
        try:
            changes = "; ".join(self._reload()) or "nothing has changed"
            log(logging.INFO, f"reloaded {self._path}: {changes}")
            return changes
        except ConfigurationError as error:
            log(logging.ERROR, f"the configuration stays as it was: {error}")
            raise
        finally:
            notify(READY)

    def _reload(self) -> list[str]:
        if self._path is None:
            raise ConfigurationError("busd was started without --config, so there is nothing to reload")
        config = load(self._path)
        changes = list(_changes(self.config, config))
        if changes:
            self._apply(config)
            self.config = config
        return changes


def _changes(old: Any, new: Any, place: str = "") -> Iterator[str]:
    for name in old.__struct_fields__:
        before, after = getattr(old, name), getattr(new, name)
        if before == after:
            continue
        if isinstance(before, BridgeTables):
            yield before.change(f"{place}{name}", after)
        elif isinstance(before, msgspec.Struct) and type(before) is type(after):
            yield from _changes(before, after, f"{place}{name}.")
        elif isinstance(before, tuple):
            as_many = len(before) == len(after)
            change = f"{_count(after)}, changed" if as_many else f"{_count(before)} -> {_count(after)}"
            yield f"{place}{name}: {change}"
        else:
            yield f"{place}{name}: {_shown(before)} -> {_shown(after)}"


def _count(rules: tuple[object, ...]) -> str:
    return f"{len(rules)} rule{'' if len(rules) == 1 else 's'}"


def _shown(value: object) -> str:
    text = str(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."

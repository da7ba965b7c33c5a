"""A program with its arguments and environment; programs import it as `launch.descriptions`."""

import itertools
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from bus_launch.launch.action import Action
from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.substitutions import LaunchConfiguration

__all__ = ["Executable"]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2

_count: Final = itertools.count(1)
_Pairs = list[tuple[list[Substitution], list[Substitution]]]


class Executable:
    """A program with its arguments, folder and environment; `prepare` makes texts of them."""

    def __init__(
        self,
        *,
        cmd: Iterable[SomeSubstitutionsType],
        prefix: SomeSubstitutionsType | None = None,
        name: SomeSubstitutionsType | None = None,
        cwd: SomeSubstitutionsType | None = None,
        env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        additional_env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        arguments: Iterable[SomeSubstitutionsType] | None = None,
    ) -> None:
        self._cmd = [normalize_to_list_of_substitutions(one) for one in cmd]
        self._cmd += [normalize_to_list_of_substitutions(one) for one in arguments or ()]
        self._prefix = normalize_to_list_of_substitutions(
            LaunchConfiguration("launch-prefix", default="") if prefix is None else prefix
        )
        self._prefix_filter = normalize_to_list_of_substitutions(
            LaunchConfiguration("launch-prefix-filter", default="")
        )
        self._name = _optional(name)
        self._cwd = _optional(cwd)
        self._env = _pairs(env)
        self._additional_env = _pairs(additional_env)
        self._final_cmd: list[str] | None = None
        self._final_prefix: list[str] = []
        self._final_name: str | None = None
        self._final_cwd: str | None = None
        self._final_env: dict[str, str] | None = None

    @property
    def cmd(self) -> list[list[Substitution]]:
        return self._cmd

    @property
    def prefix(self) -> list[Substitution]:
        return self._prefix

    @property
    def name(self) -> list[Substitution] | None:
        return self._name

    @property
    def cwd(self) -> list[Substitution] | None:
        return self._cwd

    @property
    def env(self) -> _Pairs | None:
        return self._env

    @property
    def additional_env(self) -> _Pairs | None:
        return self._additional_env

    @property
    def final_cmd(self) -> list[str] | None:
        return self._final_cmd

    @property
    def final_name(self) -> str | None:
        return self._final_name

    @property
    def final_cwd(self) -> str | None:
        return self._final_cwd

    @property
    def final_env(self) -> dict[str, str] | None:
        return self._final_env

    @property
    def has_own_env(self) -> bool:
        """Whether its environment is not the launch's own."""
        return self._env is not None or self._additional_env is not None

    def prepare(self, context: LaunchContext, action: Action) -> None:
        """Perform all substitutions, and give the process its name: `talker-1`."""
        words = [perform_substitutions(context, one) for one in self._cmd]
        if not words or not words[0].strip():
            raise ValueError("a process needs a command: its cmd is empty")
        base = Path(shlex.split(words[0])[0] if " " in words[0] else words[0]).name
        name = base if self._name is None else perform_substitutions(context, self._name)
        prefix = perform_substitutions(context, self._prefix)
        only = perform_substitutions(context, self._prefix_filter)
        self._final_prefix = [] if only and not _fits(only, base) else shlex.split(prefix)
        self._final_cmd = [*self._final_prefix, *words]
        self._final_name = f"{name}-{next(_count)}"
        self._final_cwd = None if self._cwd is None else perform_substitutions(context, self._cwd)
        # The present environment: a group around the program may end before the process starts.
        start = dict(context.environment) if self._env is None else _performed(context, self._env)
        self._final_env = start | _performed(context, self._additional_env or [])

    def command(self) -> list[str]:
        """What is executed, after `prepare`."""
        return self._final_cmd or []


def _fits(pattern: str, text: str) -> bool:
    import re

    return re.match(pattern, text) is not None


def _optional(one: SomeSubstitutionsType | None) -> list[Substitution] | None:
    return None if one is None else normalize_to_list_of_substitutions(one)


def _pairs(
    table: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None,
) -> _Pairs | None:
    if table is None:
        return None
    return [
        (normalize_to_list_of_substitutions(name), normalize_to_list_of_substitutions(value))
        for name, value in table.items()
    ]


def _performed(context: LaunchContext, pairs: _Pairs) -> dict[str, str]:
    return {
        perform_substitutions(context, name): perform_substitutions(context, value) for name, value in pairs
    }

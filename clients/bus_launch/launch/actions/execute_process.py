"""The action for a command line; programs import it from `launch.actions`."""

import shlex
from collections.abc import Iterable, Mapping
from typing import Any, Final, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.action import Action
from bus_launch.launch.actions.basic import Shutdown
from bus_launch.launch.actions.process import ExecuteLocal
from bus_launch.launch.core import SomeSubstitutionsType, Substitution, TextSubstitution
from bus_launch.launch.descriptions import Executable
from bus_launch.launch.frontend import Entity, Parser, expose_action

__all__ = ["ExecuteProcess"]

_TEXTS: Final = {
    "cwd": "cwd",
    "name": "name",
    "prefix": "launch-prefix",
    "output": "output",
    "sigterm_timeout": "sigterm_timeout",
    "sigkill_timeout": "sigkill_timeout",
}
"""Arguments that are texts, and the attributes that give them."""
_VALUES: Final = (
    ("shell", bool, False),
    ("emulate_tty", bool, False),
    ("respawn", bool, True),
    ("respawn_delay", float, False),
    ("respawn_max_retries", int, False),
)
"""Other arguments, the types of their attributes, and whether text with substitutions is allowed."""


@expose_action("executable")
class ExecuteProcess(ExecuteLocal):
    """Runs a command: its words, each of them text and substitutions; with `shell` one line for the shell."""

    def __init__(
        self,
        *,
        cmd: Iterable[SomeSubstitutionsType],
        prefix: SomeSubstitutionsType | None = None,
        name: SomeSubstitutionsType | None = None,
        cwd: SomeSubstitutionsType | None = None,
        env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        additional_env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        **kwargs: Any,
    ) -> None:
        """`env`: its whole environment; `additional_env`: additions to it. Otherwise as ExecuteLocal."""
        if isinstance(cmd, str):
            raise TypeError(f"cmd is a list of words, not the text {cmd!r}")
        executable = Executable(
            cmd=cmd, prefix=prefix, name=name, cwd=cwd, env=env, additional_env=additional_env
        )
        super().__init__(process_description=executable, **kwargs)

    @property
    def name(self) -> Any:
        """The name of the process; before the process is prepared, the configured name."""
        final = self.process_description.final_name
        return self.process_description.name if final is None else final

    @property
    def cmd(self) -> list[list[Substitution]]:
        return self.process_description.cmd

    @property
    def cwd(self) -> list[Substitution] | None:
        return self.process_description.cwd

    @property
    def env(self) -> Any:
        return self.process_description.env

    @property
    def additional_env(self) -> Any:
        return self.process_description.additional_env

    @classmethod
    def parse(
        cls, entity: Entity, parser: Parser, ignore: Iterable[str] = ()
    ) -> tuple[type[Action], dict[str, Any]]:
        """`ignore`: the names of attributes that a derived class reads itself."""
        _, kwargs = super().parse(entity, parser)
        skipped = set(ignore)
        if "cmd" not in skipped:
            kwargs["cmd"] = cls._parse_cmdline(entity.get_attr("cmd"), parser)
        for argument, attribute in _TEXTS.items():
            if argument not in skipped and (value := entity.get_attr(attribute, optional=True)) is not None:
                kwargs[argument] = parser.parse_substitution(str(value))
        for name, kind, can_be_text in _VALUES:
            if name in skipped:
                continue
            value = entity.get_attr(name, data_type=kind, optional=True, can_be_str=can_be_text)
            if value is not None:
                kwargs[name] = parser.parse_if_substitutions(value) if kind is bool else value
        if "on_exit" not in skipped and (on_exit := entity.get_attr("on_exit", optional=True)) is not None:
            if on_exit != "shutdown":
                raise ValueError(
                    f"Attribute on_exit of Entity {entity.type_name} expected to be `shutdown` but got "
                    f"`{on_exit}`"
                )
            kwargs["on_exit"] = [Shutdown()]
        if kwargs.get("respawn_delay", 0) < 0:
            raise ValueError(
                "Attribute respawn_delay of Entity node expected to be a non-negative value but got "
                f"`{kwargs['respawn_delay']}`"
            )
        variables = entity.get_attr("env", data_type=List[Entity], optional=True)  # noqa: UP006
        if variables is not None:
            kwargs["additional_env"] = _variables(variables, parser)
        return cls, kwargs

    @classmethod
    def _parse_cmdline(cls, cmd: str, parser: Parser) -> list[list[Substitution]]:
        """Words, cut at blanks as the shell does, but not inside substitutions."""
        words: list[list[Substitution]] = []
        is_open = False
        for one in parser.parse_substitution(cmd):
            if not isinstance(one, TextSubstitution):
                words = [*words[:-1], [*words[-1], one]] if is_open else [*words, [one]]
                is_open = True
                continue
            if not one.text:
                continue
            parts: list[list[Substitution]] = [
                [TextSubstitution(text=part)] for part in shlex.split(one.text)
            ]
            if is_open and parts and not one.text[0].isspace():
                words[-1] = [*words[-1], *parts.pop(0)]
            words += parts
            is_open = not one.text[-1].isspace()
        return words


def _variables(
    entities: Iterable[Entity], parser: Parser
) -> dict[tuple[Substitution, ...], list[Substitution]]:
    """The variables of `<env name= value=>`."""
    made: dict[tuple[Substitution, ...], list[Substitution]] = {}
    for one in entities:
        made[tuple(parser.parse_substitution(one.get_attr("name")))] = parser.parse_substitution(
            one.get_attr("value")
        )
        one.assert_entity_completely_parsed()
    return made

"""A launch description as text; programs import it as `launch.LaunchIntrospector`."""

from collections.abc import Iterable

from bus_launch.launch.action import Action
from bus_launch.launch.actions import EmitEvent, ExecuteProcess, LogInfo, RegisterEventHandler
from bus_launch.launch.core import (
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    normalize_to_list_of_entities,
    normalize_to_list_of_substitutions,
)
from bus_launch.launch.launch_description import LaunchDescription

__all__ = ["LaunchIntrospector"]

_Tree = tuple[str, list["_Tree"]]


class LaunchIntrospector:
    """Writes the contents of a launch description as a tree."""

    def format_launch_description(self, launch_description: LaunchDescription) -> str:
        # In ROS 2's words, by whichever name it was imported.
        lines = [f"<launch.launch_description.LaunchDescription object at {id(launch_description):#x}>"]
        lines += _branches([_tree(one) for one in launch_description.entities])
        return "\n".join(lines)


def _branches(trees: list[_Tree], indent: str = "") -> list[str]:
    lines = []
    for number, (text, below) in enumerate(trees, 1):
        is_last = number == len(trees)
        lines.append(f"{indent}{'└' if is_last else '├'}── {text}")
        lines += _branches(below, indent + ("    " if is_last else "│   "))
    return lines


def _tree(entity: LaunchDescriptionEntity) -> _Tree:
    return _text(entity), [_tree(one) for one in _below(entity)]


def _below(entity: LaunchDescriptionEntity) -> list[LaunchDescriptionEntity]:
    if isinstance(entity, RegisterEventHandler):
        return normalize_to_list_of_entities(entity.event_handler.describe()[1])
    found = list(entity.describe_sub_entities())
    for _, others in entity.describe_conditional_sub_entities():
        found += others
    return found


def _text(entity: LaunchDescriptionEntity) -> str:
    if isinstance(entity, LogInfo):
        return f"LogInfo({_joined(entity.msg)})"
    if isinstance(entity, EmitEvent):
        return f"EmitEvent(event='{entity.event.name}')"
    if isinstance(entity, ExecuteProcess):
        cmd = ", ".join(_joined(one) for one in entity.cmd)
        cwd = None if entity.cwd is None else f"'{_joined(entity.cwd)}'"
        return f"ExecuteProcess(cmd=[{cmd}], cwd={cwd}, env={_pairs(entity.env)}, shell={entity.shell})"
    if isinstance(entity, RegisterEventHandler):
        return f"RegisterEventHandler('{entity.event_handler.describe()[0]}'):"
    return f"Action('{entity.describe()}')" if isinstance(entity, Action) else entity.describe()


def _joined(substitutions: SomeSubstitutionsType) -> str:
    return " + ".join(one.describe() for one in normalize_to_list_of_substitutions(substitutions))


def _pairs(env: Iterable[tuple[SomeSubstitutionsType, SomeSubstitutionsType]] | None) -> str:
    if env is None:
        return "None"
    return "{" + ", ".join(f"{_joined(name)}: {_joined(value)}" for name, value in env) + "}"

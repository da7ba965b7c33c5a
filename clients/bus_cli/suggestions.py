"""Suggestions for unknown words: similar names, commands and verbs.

Each `near_...` returns the end of a verb's message, "" if no name is similar. Names come from the graph, and
from the definitions and packages on this machine. This module is slow and only needed after mistakes, so
import it late.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from bus.base.suggest import did_you_mean, nearest
from bus.names import is_hidden_topic
from bus_cli.program_name import program_name

if TYPE_CHECKING:
    from bus.graph import Graph
    from bus.types.definitions import Kind

__all__ = [
    "near_action",
    "near_interface_package",
    "near_node",
    "near_package",
    "near_service",
    "near_topic",
    "near_type",
    "no_command",
    "no_verb",
    "types_called",
]

_EXAMPLES = "example_interfaces/"

_NOT_YET = {
    "control": "",
    "extension_points": "",
    "extensions": "",
    "plugin": "",
    "security": "access rules are in busd.toml, under [[access]]",
    "trace": "",
}
"""Commands of ros2 that `bus` lacks, and their replacements."""

_MOST = 3
"""Most commands in one suggestion."""

_OTHER_NAMES = {"msg": "interface show", "srv": "interface show"}


def near_topic(name: str, graph: "Graph") -> str:
    return _near(name, (topic for topic in graph.topics() if not is_hidden_topic(topic)))


def near_service(name: str, graph: "Graph") -> str:
    return _near(name, (service for service in graph.services() if not is_hidden_topic(service)))


def near_action(name: str, graph: "Graph") -> str:
    from bus_actions.graph import actions_of

    return _near(name, actions_of((*graph.publishers, *graph.subscriptions)))


def near_node(name: str, graph: "Graph") -> str:
    return _near(name, {node.full_name for node in graph.nodes})


def near_type(text: str, kind: "Kind | None" = "msg", graph: "Graph | None" = None) -> str:
    """A similar type among the definitions here and, for messages, among the types on the bus."""
    from bus.types.definitions import names

    found = dict.fromkeys(names(kind))
    if graph is not None and kind == "msg":
        found |= dict.fromkeys(name for types in graph.topics().values() for name in types if "/msg/" in name)
    if text in found:
        return ""
    if "/" in text:
        return did_you_mean(text, found, 0.75)
    shorts = {name.rpartition("/")[2] for name in found}
    called = types_called(text, found) or types_called(nearest(text, sorted(shorts), 0.75) or "", found)
    return f"; did you mean {_listed(called)}?" if called else ""


def near_package(name: str) -> str:
    """A similar package among the packages with programs or a manifest."""
    from bus_ros.packages import nearest

    near = nearest(name)
    return f"; did you mean '{near}'?" if near else ""


def near_interface_package(name: str) -> str:
    """A similar package among the packages with definitions."""
    from bus.types.definitions import packages

    return did_you_mean(name, packages())


def types_called(short: str, among: Iterable[str]) -> list[str]:
    """The full names that end in `short`. Includes types of ROS's examples only if there are no others."""
    found = [name for name in among if name.rpartition("/")[2].lower() == short.lower()]
    return [name for name in found if not name.startswith(_EXAMPLES)] or found


def no_command(word: str, commands: Mapping[str, tuple[str, Iterable[str]]]) -> str:
    """The message for an unknown command WORD of the program."""
    program = program_name()
    if word in _NOT_YET:
        instead = _NOT_YET[word]
        return f"{program} {word}: not available{'; ' if instead else ''}{instead}"
    meant = [f"{program} {command} {word}" for command, (_, verbs) in commands.items() if word in verbs][
        :_MOST
    ]
    if not meant and (near := _OTHER_NAMES.get(word) or nearest(word, commands)):
        meant = [f"{program} {near}"]
    hint = f"did you mean {_listed(meant)}?" if meant else f"{program} --help lists what there is"
    return f"{program}: there is no command '{word}'; {hint}"


def no_verb(command: str, word: str, verbs: Iterable[str]) -> str:
    """The message for an unknown verb `bus COMMAND WORD`."""
    verbs = list(verbs)
    near = nearest(word, verbs)
    hint = f"did you mean '{command} {near}'?" if near else f"there are {', '.join(verbs)}"
    return f"{command}: there is no verb '{word}'; {hint}"


def _near(name: str, among: Iterable[str]) -> str:
    """A similar name; `name` may lack its leading slash, as users type it."""
    full = name if name.startswith("/") else f"/{name}"
    return did_you_mean(full, set(among) - {full})


def _listed(texts: list[str]) -> str:
    return " or ".join(f"'{text}'" for text in texts)

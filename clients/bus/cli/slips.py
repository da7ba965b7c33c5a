"""What is said to a command or a verb that does not exist. Needed for slips only: import it late."""

from collections.abc import Iterable, Mapping

from bus.spelling import nearest

__all__ = ["no_command", "no_verb"]

_NOT_YET = {
    "action": "programs can't serve or call actions; bus interface shows their definitions",
    "bag": "to record, write what bus topic echo --json prints into a file",
    "component": "several nodes in one process are several bus.Node in one main()",
    "control": "",
    "extension_points": "",
    "extensions": "",
    "launch": "start each program with bus run",
    "lifecycle": "",
    "multicast": "the bus does not leave its machine",
    "plugin": "",
    "security": "who may do what stands in busd.toml, under [[access]]",
    "test": "",
    "trace": "",
}
"""Commands of ros2, and what there is instead."""

_MOST = 3
"""Commands that are offered at once."""

_OTHER_NAMES = {"wtf": "doctor", "msg": "interface show", "srv": "interface show"}


def no_command(word: str, commands: Mapping[str, tuple[str, Iterable[str]]]) -> str:
    """Of `bus WORD`."""
    if word in _NOT_YET:
        instead = _NOT_YET[word]
        return f"bus {word}: not there yet{'; ' if instead else ''}{instead}"
    meant = [f"bus {command} {word}" for command, (_, verbs) in commands.items() if word in verbs][:_MOST]
    if not meant and (near := _OTHER_NAMES.get(word) or nearest(word, commands)):
        meant = [f"bus {near}"]
    hint = f"did you mean {_listed(meant)}?" if meant else "bus --help lists what there is"
    return f"bus: there is no command '{word}'; {hint}"


def no_verb(command: str, word: str, verbs: Iterable[str]) -> str:
    """Of `bus COMMAND WORD`."""
    verbs = list(verbs)
    near = nearest(word, verbs)
    hint = f"did you mean '{command} {near}'?" if near else f"there are {', '.join(verbs)}"
    return f"{command}: there is no verb '{word}'; {hint}"


def _listed(texts: list[str]) -> str:
    return " or ".join(f"'{text}'" for text in texts)

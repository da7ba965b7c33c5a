"""Parses launch files in YAML: from a file to its root entity."""

from typing import Any, Final, TextIO

from bus_launch.launch.frontend import Parser as BaseParser
from bus_launch.launch_yaml.entity import Entity

__all__ = ["Parser"]

_MOST_VALUES: Final = 100_000


class Parser(BaseParser):
    """Reads YAML."""

    @classmethod
    def load(cls, file: Any) -> tuple[Entity, "Parser"]:
        """Raises ValueError with line and column, and RuntimeError if there is no root."""
        import yaml  # late: most launch files are in Python

        stream: TextIO = file
        try:
            root = yaml.safe_load(stream.read())
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            place = f": line {mark.line + 1}, column {mark.column + 1}" if mark else ""
            raise ValueError(f"{error.problem}{place}") from None
        values = _count(root, {})
        if values > _MOST_VALUES:
            raise ValueError(f"more than {_MOST_VALUES:,} values, once its aliases are filled in")
        return Entity(root), cls()

    @classmethod
    def get_file_extensions(cls) -> list[str]:
        return ["yaml", "yml"]


def _count(value: object, known: dict[int, int]) -> int:
    """The number of values in it; each use of an alias counts. Raises ValueError if there is no end."""
    if not isinstance(value, list | dict):
        return 1
    if id(value) not in known:
        known[id(value)] = 0
        inside = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count(one, known) for one in inside)
    elif not known[id(value)]:
        raise ValueError("an alias is used inside what it stands for")
    return known[id(value)]

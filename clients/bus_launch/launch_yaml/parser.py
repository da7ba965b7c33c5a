"""From a file in YAML to its root entity."""

from typing import Any, TextIO

from bus_launch.launch.frontend import Parser as BaseParser
from bus_launch.launch_yaml.entity import Entity

__all__ = ["Parser"]


class Parser(BaseParser):
    """Reads YAML."""

    @classmethod
    def load(cls, file: Any) -> tuple[Entity, "Parser"]:
        """Raises ValueError with line and column, and RuntimeError where there is no root."""
        import yaml  # late: most launch files are in Python

        stream: TextIO = file
        try:
            root = yaml.safe_load(stream.read())
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            place = f": line {mark.line + 1}, column {mark.column + 1}" if mark else ""
            raise ValueError(f"{error.problem}{place}") from None
        return Entity(root), cls()

    @classmethod
    def get_file_extensions(cls) -> list[str]:
        return ["yaml", "yml"]

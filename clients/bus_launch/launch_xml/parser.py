"""Parses launch files in XML: from a file to its root entity."""

from typing import Any, TextIO
from xml.etree import ElementTree

from bus_launch.launch.frontend import Parser as BaseParser
from bus_launch.launch_xml.entity import Entity

__all__ = ["Parser"]


class Parser(BaseParser):
    """Reads XML."""

    @classmethod
    def load(cls, file: Any) -> tuple[Entity, "Parser"]:
        """Raises ElementTree.ParseError with line and column, and ValueError for text in tags."""
        stream: TextIO = file
        return Entity(ElementTree.fromstring(stream.read())), cls()

    @classmethod
    def get_file_extensions(cls) -> list[str]:
        return ["xml"]

"""Reads files in markup languages as launch descriptions. Knows no language: each has a subclass."""

import io
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Final, TextIO

from bus_launch.launch.core import Substitution
from bus_launch.launch.errors import InvalidLaunchFileError
from bus_launch.launch.frontend import expose, grammar
from bus_launch.launch.frontend.entity import Entity

__all__ = ["InvalidFrontendLaunchFileError", "Parser"]

_LANGUAGES: Final = {"xml": "bus_launch.launch_xml", "yaml": "bus_launch.launch_yaml"}
_OTHER_ENDS: Final = {"yml": "yaml"}
_TAGS: Final = ("bus_launch.launch.actions", "bus_launch.launch.substitutions", "bus_launch.launch_ros")
"""Modules that expose tags and substitutions when they are imported; users' modules have entry points."""


class InvalidFrontendLaunchFileError(InvalidLaunchFileError):
    """A launch file in a markup language that can't be read."""


class Parser:
    """Makes actions of entities, substitutions of texts."""

    _are_extensions_loaded: ClassVar[bool] = False
    _parsers: ClassVar[dict[str, type["Parser"]]] = {}

    @classmethod
    def load_launch_extensions(cls) -> None:
        """Make all tags and substitutions known: from here, and from installed distributions."""
        if Parser._are_extensions_loaded:
            return
        Parser._are_extensions_loaded = True
        for name in _TAGS:
            import_module(name)
        for entry in _entry_points("launch.frontend.launch_extension"):
            entry.load()

    def parse_action(self, entity: Entity) -> Any:
        self.load_launch_extensions()
        return expose.instantiate_action(entity, self)

    def parse_substitution(self, value: str) -> list[Substitution]:
        self.load_launch_extensions()
        return grammar.parse_substitution(value)

    def parse_if_substitutions(self, value: Any) -> Any:
        self.load_launch_extensions()
        return grammar.parse_if_substitutions(value)

    def escape_characters(self, value: str) -> str:
        return grammar.replace_escaped_characters(value)

    def parse_description(self, entity: Entity) -> Any:
        """The launch description from the root of a file."""
        if entity.type_name != "launch":
            raise RuntimeError("Expected 'launch' as root tag")
        deprecated = entity.get_attr("deprecated", optional=True)
        entity.get_attr("version", optional=True)
        actions = [self.parse_action(child) for child in entity.children]
        entity.assert_entity_completely_parsed()
        return expose.instantiate_description(actions, deprecated)

    @classmethod
    def get_available_extensions(cls) -> list[str]:
        return [*_LANGUAGES, *_OTHER_ENDS]

    @classmethod
    def is_extension_valid(cls, extension: str) -> bool:
        return extension in cls.get_available_extensions()

    @classmethod
    def get_parser_from_extension(cls, extension: str) -> "type[Parser]":
        language = _OTHER_ENDS.get(extension, extension)
        if language not in _LANGUAGES:
            raise RuntimeError("Not recognized frontend implementation")
        if language not in Parser._parsers:
            Parser._parsers[language] = import_module(_LANGUAGES[language]).Parser
        return Parser._parsers[language]

    @classmethod
    def get_file_extensions(cls) -> Iterable[str]:
        return cls.get_available_extensions()

    @classmethod
    def load(cls, file: str | TextIO) -> tuple[Entity, "Parser"]:
        """Read a file in the language of its suffix; if that is unknown, in the first one that can read it.

        Raises OSError, UnicodeDecodeError, and InvalidFrontendLaunchFileError, which names the fault.
        """
        if isinstance(file, str | Path):
            name = str(file)
            text = Path(file).read_text("utf-8")
        else:
            name = getattr(file, "name", "")
            text = file.read()
        end = Path(name).suffix.removeprefix(".")
        ends = [end] if cls.is_extension_valid(end) else list(_LANGUAGES)
        problems: list[Exception] = []
        for one in ends:
            stream = io.StringIO(text)
            stream.name = name
            try:
                return cls.get_parser_from_extension(one).load(stream)
            except Exception as error:
                problems.append(error)
        raise InvalidFrontendLaunchFileError(end if len(ends) == 1 else "", likely_errors=problems)


def _entry_points(group: str) -> Iterable[Any]:
    from importlib.metadata import entry_points

    return entry_points(group=group)

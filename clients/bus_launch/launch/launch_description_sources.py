"""Reads launch files as launch descriptions; programs import it as `launch.launch_description_sources`."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.errors import InvalidLaunchFileError, describe, short
from bus_launch.launch.frontend import InvalidFrontendLaunchFileError, Parser
from bus_launch.launch.launch_description import LaunchDescription

__all__ = [
    "AnyLaunchDescriptionSource",
    "FrontendLaunchDescriptionSource",
    "InvalidFrontendLaunchFileError",
    "InvalidPythonLaunchFileError",
    "LaunchDescriptionSource",
    "PythonLaunchDescriptionSource",
    "XMLLaunchDescriptionSource",
    "YAMLLaunchDescriptionSource",
    "get_launch_description_from_any_launch_file",
    "get_launch_description_from_frontend_launch_file",
    "get_launch_description_from_python_launch_file",
    "load_python_launch_file_as_module",
]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2


class InvalidPythonLaunchFileError(InvalidLaunchFileError):
    """A Python file that has no generate_launch_description()."""


def load_python_launch_file_as_module(python_launch_file_path: str) -> Any:
    """Run a file as a separate module."""
    from importlib.machinery import SourceFileLoader
    from importlib.util import module_from_spec, spec_from_loader

    loader = SourceFileLoader("python_launch_file", python_launch_file_path)
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def get_launch_description_from_python_launch_file(python_launch_file_path: str) -> LaunchDescription:
    """Call the file's generate_launch_description()."""
    module = load_python_launch_file_as_module(python_launch_file_path)
    make = getattr(module, "generate_launch_description", None)
    if make is None:
        raise InvalidPythonLaunchFileError(
            "py",
            likely_errors=[
                RuntimeError(
                    f"launch file at '{python_launch_file_path}' does not contain the required function "
                    "'generate_launch_description()'"
                )
            ],
        )
    made = make()
    if made is None:
        raise TypeError("generate_launch_description() returned None: does it lack a return?")
    if not isinstance(made, LaunchDescription):
        raise TypeError(f"generate_launch_description() returned no LaunchDescription, but {short(made)}")
    return made


def get_launch_description_from_frontend_launch_file(
    launch_file_path: str, *, parser: type[Parser] = Parser
) -> LaunchDescription:
    """Read a file in a markup language."""
    root, reader = parser.load(launch_file_path)
    made: LaunchDescription = reader.parse_description(root)
    return made


def get_launch_description_from_any_launch_file(launch_file_path: str) -> LaunchDescription:
    """Read a file in the format of its suffix; if that is unknown, in the first one that can read it.

    Raises OSError, and InvalidLaunchFileError with what is wrong with it.
    """
    with open(launch_file_path, "rb"):  # noqa: PTH123 (say that it can't be read before reading it as anything)
        pass
    end = Path(launch_file_path).suffix.removeprefix(".")
    loaders: list[Callable[[str], LaunchDescription]] = [
        get_launch_description_from_python_launch_file,
        get_launch_description_from_frontend_launch_file,
    ]
    if end == "py":
        del loaders[1]
    elif Parser.is_extension_valid(end):
        del loaders[0]
    problems: list[Exception] = []
    for load in loaders:
        try:
            return load(launch_file_path)
        except InvalidLaunchFileError as error:
            problems += [_located(one, launch_file_path) for one in error._likely_errors]
        except Exception as error:
            problems.append(_located(error, launch_file_path))
    raise InvalidLaunchFileError(end if len(loaders) == 1 else "", likely_errors=problems)


def _located(error: Exception, path: str) -> Exception:
    """The error with the file that led to it (and the line, for Python), if its text lacks them."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return error
    if not path.endswith(".py"):
        return _Located(error, Path(path).name)
    lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == path]
    if not lines:
        return error
    place = f"{Path(path).name}, line {lines[-1]}"
    return _Located(error, place)


class _Located(Exception):
    """Another error, with its place in a launch file."""

    def __init__(self, error: Exception, place: str) -> None:
        kind = "" if isinstance(error, RuntimeError | ValueError) else f"{type(error).__name__}: "
        super().__init__(f"{kind}{describe(error)} ({place})")
        self.__cause__ = error


class LaunchDescriptionSource:
    """A launch description, read on demand from a file. The file's path may hold substitutions."""

    def __init__(
        self,
        launch_description: LaunchDescription | None = None,
        location: SomeSubstitutionsType = "<script>",
        method: str = "unspecified mechanism from a script",
    ) -> None:
        self.__description = launch_description
        self.__is_given = launch_description is not None
        self.__location = normalize_to_list_of_substitutions(location)
        self.__expanded: str | None = None
        self.__method = method

    @property
    def method(self) -> str:
        return self.__method

    @property
    def location(self) -> str:
        """The path; before it is known, a description of it."""
        if self.__expanded is not None:
            return self.__expanded
        return " + ".join(one.describe() for one in self.__location)

    @property
    def location_substitutions(self) -> list[Substitution]:
        return self.__location

    def try_get_launch_description_without_context(self) -> LaunchDescription | None:
        """None if the path is known only in a launch."""
        if self.__description is None:
            try:
                return self.get_launch_description(LaunchContext())
            except Exception:
                return None
        return self.__description

    def get_launch_description(self, context: LaunchContext) -> LaunchDescription:
        # An inspection before the launch has other configurations, so its path may be another one.
        path = perform_substitutions(context, self.__location)
        if path != self.__expanded and not self.__is_given:
            self.__description = None
        self.__expanded = path
        if self.__description is None:
            self.__description = self._get_launch_description(path)
        return self.__description

    def _get_launch_description(self, location: str) -> LaunchDescription:
        raise NotImplementedError(f"{type(self).__name__} can't read '{location}'")


class PythonLaunchDescriptionSource(LaunchDescriptionSource):
    """A Python launch file."""

    def __init__(self, launch_file_path: SomeSubstitutionsType) -> None:
        super().__init__(None, launch_file_path, "interpreted python launch file")

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_python_launch_file(location)


class FrontendLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file in a markup language."""

    def __init__(
        self,
        launch_file_path: SomeSubstitutionsType,
        *,
        method: str = "interpreted frontend launch file",
        parser: type[Parser] = Parser,
    ) -> None:
        super().__init__(None, launch_file_path, method)
        self.__parser = parser

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_frontend_launch_file(location, parser=self.__parser)


class XMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in XML."""


class YAMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in YAML."""


class AnyLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file of any kind."""

    def __init__(self, launch_file_path: SomeSubstitutionsType) -> None:
        super().__init__(None, launch_file_path, "interpreted launch file")

    def _get_launch_description(self, location: str) -> LaunchDescription:
        return get_launch_description_from_any_launch_file(location)

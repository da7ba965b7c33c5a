"""Substitutions of Nav2's launch files: parameter files with other values, robots and their poses.

A substitution's file is removed when the launch has ended.
"""

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bus_launch.launch.core import (
    Condition,
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.substitutions import LaunchConfiguration
from bus_launch.launch.substitutions.values import described
from bus_launch.launch.yaml_values import dump

__all__ = ["HasNodeParams", "LaunchConfigAsBool", "ParseMultiRobotPose", "ReplaceString", "RewrittenYaml"]

_Texts = Mapping[str, SomeSubstitutionsType]
_TRUE = ("true", "1", "yes", "on")
_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


class _OfFile(Substitution):
    """Base of substitutions that read a file."""

    def __init__(self, source_file: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__source_file = normalize_to_list_of_substitutions(source_file)

    @property
    def name(self) -> list[Substitution]:
        return self.__source_file

    def describe(self) -> str:
        return f"{type(self).__name__}({described(self.name)})"

    def _path(self, context: LaunchContext) -> str:
        return perform_substitutions(context, self.name)

    def _text(self, context: LaunchContext) -> str:
        path = self._path(context)
        try:
            return Path(path).read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SubstitutionFailure(f"can't read '{path}': {error}") from None

    def _yaml(self, context: LaunchContext) -> Any:
        import yaml

        try:
            return yaml.safe_load(self._text(context))
        except yaml.YAMLError as error:
            raise SubstitutionFailure(f"'{self._path(context)}' is no YAML: {error}") from None


class RewrittenYaml(_OfFile):
    """The path of a copy of a YAML file, with other values and keys.

    `param_rewrites` has new values: of each key with a name, or of one key with a path (dots in it, such as
    `amcl.ros__parameters.x`). A path with `ros__parameters` also adds a missing value. `key_rewrites` are
    other names of keys, `root_key` is a key above all. `convert_types`: texts of numbers become numbers;
    `true` and `false` are truth values in any case.
    """

    def __init__(
        self,
        source_file: SomeSubstitutionsType,
        param_rewrites: _Texts,
        root_key: SomeSubstitutionsType | None = None,
        key_rewrites: _Texts | None = None,
        convert_types: bool = False,
    ) -> None:
        super().__init__(source_file)
        self.__values = _normalized(param_rewrites)
        self.__keys = _normalized(key_rewrites or {})
        self.__root_key = None if root_key is None else normalize_to_list_of_substitutions(root_key)
        self.__convert_types = convert_types

    def perform(self, context: LaunchContext) -> str:
        data = self._yaml(context)
        values = {
            name: _value(text, numbers=self.__convert_types)
            for name, text in _performed(context, self.__values)
        }
        data = _with_values(data, values, "")
        for path, value in values.items():
            if "ros__parameters" in path.split("."):
                _put(data, path, value)
        data = _with_keys(data, dict(_performed(context, self.__keys)))
        root = "" if self.__root_key is None else perform_substitutions(context, self.__root_key)
        return _write(context, dump({root: data} if root else data))


class ReplaceString(_OfFile):
    """The path of a copy of a file with other texts in it; of the file itself if `condition` is false."""

    def __init__(
        self, source_file: SomeSubstitutionsType, replacements: _Texts, condition: Condition | None = None
    ) -> None:
        super().__init__(source_file)
        self.__replacements = _normalized(replacements)
        self.__condition = condition

    @property
    def condition(self) -> Condition | None:
        return self.__condition

    def perform(self, context: LaunchContext) -> str:
        if self.__condition is not None and not self.__condition.evaluate(context):
            return self._path(context)
        text = self._text(context)
        for old, new in _performed(context, self.__replacements):
            text = text.replace(old, new)
        return _write(context, text)


class HasNodeParams(_OfFile):
    """`True` if a parameter file has a node of that name, else `False`."""

    def __init__(self, source_file: SomeSubstitutionsType, node_name: str) -> None:
        super().__init__(source_file)
        self.__node_name = node_name

    def perform(self, context: LaunchContext) -> str:
        data = self._yaml(context)
        return str(isinstance(data, dict) and self.__node_name in data)


class LaunchConfigAsBool(Substitution):
    """`True` if a launch configuration is true, 1, yes or on, else `False`."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.__configuration = LaunchConfiguration(name)

    def describe(self) -> str:
        return f"LaunchConfigAsBool({self.__configuration.describe()})"

    def perform(self, context: LaunchContext) -> str:
        return str(self.__configuration.perform(context).strip().lower() in _TRUE)


class ParseMultiRobotPose(Substitution):
    """Robots and their places: `one={x: 1.0, yaw: 1.57}; two={y: 2.0}`, as a dict of dicts.

    A substitution gives it by `perform`, as in newer releases; an argument of the command line, by `value`.
    """

    def __init__(self, robots_argument: str | Substitution) -> None:
        super().__init__()
        self.__robots = robots_argument

    def describe(self) -> str:
        return f"ParseMultiRobotPose({self.__robots!r})"

    def perform(self, context: LaunchContext) -> Any:
        robots = self.__robots
        return _robots(robots.perform(context) if isinstance(robots, Substitution) else self.__given())

    def value(self) -> dict[str, dict[str, float]]:
        return _robots(self.__given())

    def __given(self) -> str:
        begin = f"{self.__robots}:="
        return next((word.removeprefix(begin) for word in sys.argv if word.startswith(begin)), "")


def _normalized(texts: _Texts) -> dict[str, list[Substitution]]:
    return {name: normalize_to_list_of_substitutions(text) for name, text in texts.items()}


def _performed(context: LaunchContext, texts: dict[str, list[Substitution]]) -> Iterator[tuple[str, str]]:
    return ((name, perform_substitutions(context, text)) for name, text in texts.items())


def _value(text: str, *, numbers: bool) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if numbers:
        try:
            return float(text) if "." in text else int(text)
        except ValueError:
            pass
    return text


def _with_values(data: Any, values: Mapping[str, Any], path: str) -> Any:
    """The whole path takes precedence over the key alone."""
    if isinstance(data, dict):
        made = {
            key: _with_values(one, values, f"{path}.{key}" if path else f"{key}") for key, one in data.items()
        }
        return {
            key: values[key] if key in values and f"{path}.{key}".lstrip(".") not in values else one
            for key, one in made.items()
        }
    if isinstance(data, list):
        return [_with_values(one, values, f"{path}.{number}") for number, one in enumerate(data)]
    return values.get(path, data)


def _put(data: Any, path: str, value: Any) -> None:
    """Put a value at the end of a path through dicts; missing dicts are made."""
    *above, last = path.split(".")
    try:
        for key in above:
            data = data[int(key)] if isinstance(data, list) else data.setdefault(key, {})
        data[int(last) if isinstance(data, list) else last] = value
    except (AttributeError, IndexError, TypeError, ValueError):
        raise SubstitutionFailure(f"there is no place for '{path}' in the file") from None


def _with_keys(data: Any, names: Mapping[str, str]) -> Any:
    if not isinstance(data, dict):
        return data
    return {names.get(key, key): _with_keys(one, names) for key, one in data.items()}


def _robots(text: str) -> dict[str, dict[str, float]]:
    import yaml

    found = {}
    for one in filter(None, map(str.strip, text.split(";"))):
        name, equals, pose = one.partition("=")
        given = yaml.safe_load(pose) if equals else None
        if not isinstance(given, dict):
            raise SubstitutionFailure(f"'{one}' is no robot: expected 'name={{x: 1.0, y: 1.0, yaw: 0.0}}'")
        found[name.strip()] = {**dict.fromkeys(_POSE, 0.0), **given}
    return found


def _write(context: LaunchContext, text: str) -> str:
    fd, path = tempfile.mkstemp(prefix="launch_nav2_", suffix=".yaml")
    with os.fdopen(fd, "w", encoding="utf-8") as file:
        file.write(text)
    context._at_end.append(lambda: Path(path).unlink(missing_ok=True))
    return path

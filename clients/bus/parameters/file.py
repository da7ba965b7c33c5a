"""Parameters as text: YAML files of parameters, and the values of `-p name:=value`.

Owns: the type of a scalar (by the rules of rcl_yaml_param_parser, which differ from PyYAML's: `1e3` is a
number, a date or `null` is a text), the names of nested parameters, the nodes of a file's section. Must not
know: declared parameters, their types and rules (`bus.parameters.values`), or the bus.

    /robot/wheels:              the node's full name; `/**` every node, `/*` one token of any name
      ros__parameters:
        speed: 1.5
        left: {gain: 2}         the parameter left.gain
"""

import re
from collections.abc import Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from bus.errors import ConfigurationError
from bus.parameters.values import SEPARATOR
from bus.process.ros_args import Parameter, ParameterSource

if TYPE_CHECKING:  # its import takes milliseconds
    from pathlib import Path

__all__ = [
    "PARAMETERS_KEY",
    "Section",
    "Value",
    "load",
    "overrides",
    "parse_file",
    "parse_scalar",
    "parse_typed",
    "parse_value",
    "read_file",
]

Value: TypeAlias = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]
_Scalar: TypeAlias = bool | int | float | str | None

PARAMETERS_KEY = "ros__parameters"

_TRUE = frozenset(("y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"))
_FALSE = frozenset(("n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"))
_NOTHING = frozenset(("", "~", "null", "Null", "NULL"))
_INTEGER = re.compile(r"[-+]?(?:0[xX][0-9a-fA-F]+|(0[0-7]+)|0|[1-9][0-9]*)", re.ASCII)
_FLOAT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_SPECIAL = re.compile(r"([-+]?)\.(?:inf|Inf|INF|(nan|NaN|NAN))")
_SIMPLE = re.compile(r"[A-Za-z0-9_+./][A-Za-z0-9_+./-]*|-[0-9.][0-9.eE+-]*", re.ASCII)
_INT64 = range(-(2**63), 2**63)
_TAG = "tag:yaml.org,2002:"
_PLAIN = "!plain"


class Section(NamedTuple):
    """Parameters by their full (dotted) names, for nodes with a full name that matches `pattern`."""

    pattern: str
    parameters: dict[str, Value]

    def is_for(self, full_name: str) -> bool:
        return _pattern(self.pattern).fullmatch(full_name) is not None


def load(sources: Iterable[ParameterSource]) -> tuple[Section, ...]:
    """The parameters of a command line, including those in its files: one section for each pattern.

    Patterns keep the order of their first appearance, as in rcl. Raises ConfigurationError, naming the
    unusable rule or file.
    """
    merged: dict[str, Section] = {}
    for section in _load(sources):
        merged.setdefault(section.pattern, Section(section.pattern, {})).parameters.update(section.parameters)
    return tuple(merged.values())


def overrides(sections: Iterable[Section], full_name: str) -> dict[str, Value]:
    """The values for one node. If two sections set the same parameter, the later one wins."""
    found: dict[str, Value] = {}
    for section in sections:
        if section.is_for(full_name):
            found.update(section.parameters)
    return found


def read_file(path: "str | Path") -> list[Section]:
    """The sections of a file of parameters. Raises ConfigurationError naming file and line."""
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123
            text = file.read()
    except OSError as error:
        raise ConfigurationError(f"cannot read '{path}': {error.strerror or error}") from None
    except ValueError:
        raise ConfigurationError(f"'{path}' is not UTF-8 text") from None
    return parse_file(text, str(path))


def parse_file(text: str, name: str) -> list[Section]:
    """The sections in the text of a file; `name` is for errors. An empty file has none."""
    root = _compose(text, name)
    return [] if root is None else list(_Reader(name).sections(root, ""))


def parse_value(text: str) -> Value:
    """Parse one value in YAML. Raises ConfigurationError for a value that no parameter can have."""
    if _SIMPLE.fullmatch(text):  # nearly always true, and saves the import of YAML
        scalar = parse_scalar(text)
        if scalar is not None:
            return scalar
    root = _compose(text, "")
    if root is None:
        raise ConfigurationError("there is no value")
    return _Reader("").value(root, "")


def parse_typed(text: str) -> Value:
    """Parse a value that a user typed at a tool. A text that is no value in YAML is used as it is."""
    # As in ROS: PyYAML reads typed values, rcl reads files and values after -p.
    if text in ("y", "Y", "n", "N"):
        return text
    try:
        return parse_value(text)
    except ConfigurationError:
        return text


def parse_scalar(text: str) -> _Scalar:
    """The value of an unquoted scalar, by rcl's rules; None for YAML's null and for no value at all."""
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    if text in _NOTHING:
        return None
    if (number := _INTEGER.fullmatch(text)) and len(text) < 100:
        value = int(text, 8) if number[1] else int(text, 0)
        return value if value in _INT64 else float(value)
    if _FLOAT.fullmatch(text):
        return float(text)
    if special := _SPECIAL.fullmatch(text):
        return float("nan") if special[2] else float(f"{special[1]}inf")
    return text


def _load(sources: Iterable[ParameterSource]) -> Iterator[Section]:
    for source in sources:
        if isinstance(source, Parameter):
            node = "" if source.node is None else f"{source.node}:"
            try:
                value = parse_value(source.value)
            except ConfigurationError as error:
                raise ConfigurationError(
                    "Couldn't parse parameter override rule: "
                    f"'-p {node}{source.name}:={source.value}'. Error: {error}"
                ) from None
            pattern = "/**" if source.node is None else f"/**/{source.node}"
            yield Section(pattern, {source.name: value})
        else:
            try:
                yield from read_file(source.path)
            except ConfigurationError as error:
                raise ConfigurationError(
                    f"Couldn't parse params file: '--params-file {source.path}'. Error: {error}"
                ) from None


class _Reader:
    """Converts YAML's nodes to values; has the file's name for errors."""

    def __init__(self, name: str) -> None:
        self._name = name

    def sections(self, node: Any, path: str) -> Iterator[Section]:
        """The sections below a node. Names of namespaces and nodes may be one key or nested keys."""
        for key, child in self._items(node):
            if key == PARAMETERS_KEY:
                if not path:
                    raise self._error(child, f"no name of a node stands before {PARAMETERS_KEY}")
                yield Section(path, dict(self._flat(child, "")))
            elif child.id != "mapping":
                raise self._error(child, f"'{key}' has a value, but stands before {PARAMETERS_KEY}")
            else:
                yield from self.sections(child, f"{path}/{key.strip('/')}")

    def value(self, node: Any, name: str) -> Value:
        if node.id == "scalar":
            return self._scalar(node, name)
        if node.id != "sequence":
            raise self._error(node, "a parameter's value can't be a mapping")
        items: list[Any] = [self._scalar(child, name) for child in node.value]
        kinds = {type(item) for item in items}
        if kinds == {int, float}:
            return [float(item) for item in items]
        if len(kinds) > 1:
            words = " and ".join(sorted(kind.__name__ for kind in kinds))
            raise self._error(node, f"{_of(name)}a list must hold values of one type, not {words}")
        return items

    def _flat(self, node: Any, prefix: str) -> Iterator[tuple[str, Value]]:
        for key, child in self._items(node):
            name = f"{prefix}{key}"
            if child.id == "mapping":
                yield from self._flat(child, name + SEPARATOR)
            else:
                yield name, self.value(child, name)

    def _items(self, node: Any) -> Iterator[tuple[str, Any]]:
        if node.id == "scalar" and node.value == "":
            return  # `ros__parameters:` with nothing below
        if node.id != "mapping":
            raise self._error(node, "a mapping (name: value) was expected")
        for key, child in node.value:
            if key.id != "scalar":
                raise self._error(key, "a name must be a text")
            yield key.value, child

    def _scalar(self, node: Any, name: str) -> bool | int | float | str:
        if node.id != "scalar":
            raise self._error(node, f"{_of(name)}a list must hold plain values, no lists and no mappings")
        if node.tag in (f"{_TAG}str", f"{_TAG}null"):
            return str(node.value)
        if node.tag not in (_PLAIN, f"{_TAG}int", f"{_TAG}float", f"{_TAG}bool"):
            raise self._error(node, f"{_of(name)}the tag '{node.tag}' is not known")
        if node.value == "":
            raise self._error(node, f"{_of(name)}there is no value")
        value = parse_scalar(node.value)
        return str(node.value) if value is None else value  # rcl has no null: `~` is a text

    def _error(self, node: Any, text: str) -> ConfigurationError:
        return ConfigurationError(f"{self._name}:{node.start_mark.line + 1}: {text}" if self._name else text)


def _of(name: str) -> str:
    return f"parameter '{name}': " if name else ""


def _compose(text: str, name: str) -> Any:
    """The root of YAML's tree; None for an empty text."""
    import yaml

    where = f"{name}: " if name else ""
    try:
        return yaml.compose(text, Loader=_loader())
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
        mark = getattr(error, "problem_mark", None)
        where = where if mark is None or not name else f"{name}:{mark.line + 1}: "
        raise ConfigurationError(f"{where}{problem}") from None
    except RecursionError:
        raise ConfigurationError(f"{where}nested too deeply") from None


@cache
def _loader() -> Any:
    """PyYAML's loader, but with plain scalars left as texts, and without aliases (like rcl)."""
    import yaml

    base: Any = yaml.SafeLoader

    class Loader(base):  # type: ignore[misc,unused-ignore]
        def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
            if kind is yaml.ScalarNode and implicit[0]:
                return _PLAIN
            return super().resolve(kind, value, implicit)

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark
                raise yaml.composer.ComposerError(None, None, "aliases are not supported", mark)
            return super().compose_node(parent, index)

    return Loader


@cache
def _pattern(text: str) -> re.Pattern[str]:
    wild = {"/**": r"(?:/\w+)*", "/*": r"/\w+"}
    absolute = text if text.startswith("/") else f"/{text}"
    absolute = re.sub(r"(?:/\*\*)+(?=/|$)", "/**", absolute)  # repetitions have no effect, and take time
    parts = re.split(r"(/\*\*?(?=/|$))", absolute)
    return re.compile("".join(wild.get(part) or re.escape(part) for part in parts))

"""ROS-style command line arguments: remap rules, parameters and log levels between `--ros-args` and `--`.

A remap rule outside of them, `name:=value`, is deprecated in ROS 2, and is obeyed as there.

Owns their grammar (rcl/arguments.c, parse_*) and the application of remap rules (rcl/remap.c). Must not know
the meaning of a parameter, and must not read parameter files: values stay YAML text.
"""

import re
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import TypeAlias

import msgspec

from bus import names
from bus.errors import ConfigurationError

__all__ = [
    "Arguments",
    "LogLevel",
    "Parameter",
    "ParameterFile",
    "RemapKind",
    "RemapRule",
    "UnknownArguments",
    "remove_ros_args",
]

_LOG_LEVELS = ("UNSET", "DEBUG", "INFO", "WARN", "ERROR", "FATAL")
_PARAMETER_NAME = r"[A-Za-z0-9_/]+(?:\.[A-Za-z0-9_/]+)*"


class UnknownArguments(ConfigurationError):
    """ROS arguments that ROS 2 does not have."""


class RemapKind(Enum):
    """The kind of name that a remap rule replaces."""

    NODE_NAME = "__node"
    NAMESPACE = "__ns"
    TOPIC = "rostopic"
    SERVICE = "rosservice"
    TOPIC_OR_SERVICE = "topic or service"


class RemapRule(msgspec.Struct, frozen=True):
    """A rule `-r [node:][rostopic://]match:=replacement`; `match` is empty for __node and __ns."""

    kind: RemapKind
    match: str
    replacement: str
    node: str | None = None
    """The only node for the rule; None = every node. The name is the node's name after its own remapping."""


class Parameter(msgspec.Struct, frozen=True):
    """A parameter, `-p [node:]name:=value`."""

    name: str
    value: str
    """YAML text."""
    node: str | None = None


class ParameterFile(msgspec.Struct, frozen=True):
    """A file of parameters, `--params-file path`."""

    path: str


class LogLevel(msgspec.Struct, frozen=True):
    """A log level, `--log-level [logger:=]severity`."""

    severity: str
    """UNSET, DEBUG, INFO, WARN, ERROR or FATAL."""
    logger: str = ""
    """Empty = the default of every logger."""


ParameterSource: TypeAlias = Parameter | ParameterFile


class Arguments(msgspec.Struct, frozen=True):
    """The ROS arguments of a command line, for all nodes of the process."""

    remaps: tuple[RemapRule, ...] = ()
    parameters: tuple[ParameterSource, ...] = ()
    """In their order: if two set the same parameter, the later one wins."""
    log_levels: tuple[LogLevel, ...] = ()
    """In their order: if two set the same logger, the later one wins."""
    log_to_console: bool = True
    log_to_rosout: bool = True
    deprecated: tuple[str, ...] = ()
    """The remap rules outside of --ros-args; `remaps` has them, too."""
    remaining: tuple[str, ...] = ()
    """All other arguments, in order."""

    @classmethod
    def parse(cls, argv: Sequence[str]) -> "Arguments":
        """Take the ROS arguments out of a command line, with or without the program's name in front.

        Raises ConfigurationError, naming the rule, for an unusable rule, and UnknownArguments for unknown ROS
        arguments.
        """
        remaps: list[RemapRule] = []
        parameters: list[ParameterSource] = []
        log_levels: list[LogLevel] = []
        switches = {"stdout-logs": True, "rosout-logs": True, "external-lib-logs": True}
        deprecated: list[str] = []
        remaining: list[str] = []
        unknown: list[str] = []
        inside = False
        rest = iter(argv)
        for argument in rest:
            if argument == "--ros-args":
                inside = True
            elif not inside:
                if (rule := _deprecated_rule(argument)) is None:
                    remaining.append(argument)
                else:
                    remaps.append(rule)
                    deprecated.append(argument)
            elif argument == "--":
                inside = False
            elif argument in ("-r", "--remap"):
                remaps.append(_parse_remap(argument, _value(rest, argument, "remap rule")))
            elif argument in ("-p", "--param"):
                parameters.append(
                    _parse_parameter(argument, _value(rest, argument, "parameter override rule"))
                )
            elif argument == "--params-file":
                parameters.append(ParameterFile(_value(rest, argument, "file path")))
            elif argument == "--log-level":
                log_levels.append(_parse_log_level(argument, _value(rest, argument, "log level")))
            elif argument in ("-e", "--enclave", "--log-config-file", "--log-file-name"):
                _value(rest, argument, "value")  # arguments of ROS 2 without a meaning here
            elif (switch := _parse_switch(argument)) is not None and switch[0] in switches:
                switches[switch[0]] = switch[1]
            else:
                unknown.append(argument)
        if unknown:
            raise UnknownArguments(f"Found unknown ROS arguments: {unknown}")
        return cls(
            remaps=tuple(remaps),
            parameters=tuple(parameters),
            log_levels=tuple(log_levels),
            log_to_console=switches["stdout-logs"],
            log_to_rosout=switches["rosout-logs"],
            deprecated=tuple(deprecated),
            remaining=tuple(remaining),
        )

    def node_name(self, name: str) -> str:
        """The name of a node that the program made as `name`."""
        return self._replacement(RemapKind.NODE_NAME, name) or name

    def namespace(self, namespace: str, node: str) -> str:
        """The namespace of a node made in `namespace`; `node` is its name after `node_name()`."""
        return self._replacement(RemapKind.NAMESPACE, node) or namespace

    def topic(self, full_name: str, node: str, namespace: str) -> str:
        """The remapped full name of a topic in a node with an already remapped name and namespace.

        Both sides of a rule are expanded; the first matching rule is applied, once.
        """
        return self._remapped(full_name, node, namespace, RemapKind.TOPIC) if self.remaps else full_name

    def service(self, full_name: str, node: str, namespace: str) -> str:
        """The remapped full name of a service; as `topic`."""
        return self._remapped(full_name, node, namespace, RemapKind.SERVICE)

    def _remapped(self, full_name: str, node: str, namespace: str, kind: RemapKind) -> str:
        for rule in self.remaps:
            if rule.kind not in (kind, RemapKind.TOPIC_OR_SERVICE) or rule.node not in (None, node):
                continue
            try:
                match = names.topic_in_node(rule.match, node, namespace)
            except ConfigurationError:
                continue  # as rcl: a rule that can't be expanded in this node is not for this node
            if match == full_name:
                return names.topic_in_node(rule.replacement, node, namespace)
        return full_name

    def _replacement(self, kind: RemapKind, node: str) -> str | None:
        for rule in self.remaps:
            if rule.kind is kind and rule.node in (None, node):
                return rule.replacement
        return None


def remove_ros_args(argv: Sequence[str]) -> list[str]:
    """The command line without its ROS arguments, for the program's own parser."""
    return list(Arguments.parse(argv).remaining)


def _value(rest: Iterator[str], flag: str, what: str) -> str:
    value = next(rest, None)
    if value is None:
        raise ConfigurationError(f"Couldn't parse trailing {flag} flag. No {what} found.")
    return value


def _deprecated_rule(argument: str) -> RemapRule | None:
    if ":=" not in argument or "{" in argument:
        return None
    try:
        return _parse_remap("", argument)
    except ConfigurationError:
        return None


def _parse_remap(flag: str, rule: str) -> RemapRule:
    try:
        kind, plain = _split_kind(rule)
        node, match, replacement = _split_rule(plain)
        if match.startswith("__") and kind is not RemapKind.TOPIC_OR_SERVICE:
            raise ConfigurationError(f"'{match}' is no name of a {kind.value.removeprefix('ros')}")
        if match in ("__node", "__name"):
            names.validate_node_name(replacement)
            return RemapRule(RemapKind.NODE_NAME, "", replacement, node)
        if match == "__ns":
            names.validate_namespace(replacement)
            return RemapRule(RemapKind.NAMESPACE, "", replacement, node)
        for side in (match, replacement):
            names.validate_topic_name(side)
            if "//" in side:
                raise ConfigurationError(f"topic name must not contain repeated '/': '{side}'")
    except ConfigurationError as error:
        raise ConfigurationError(f"Couldn't parse remap rule: '{flag} {rule}'. Error: {error}") from None
    return RemapRule(kind, match, replacement, node)


def _split_kind(rule: str) -> tuple[RemapKind, str]:
    """The kind that a prefix (`rostopic://`) gives, and the rule without the prefix."""
    for kind in (RemapKind.TOPIC, RemapKind.SERVICE):
        if found := re.match(rf"((?:\w+:)?){kind.value}://", rule):
            return kind, found[1] + rule[found.end() :]
    return RemapKind.TOPIC_OR_SERVICE, rule


def _parse_parameter(flag: str, rule: str) -> Parameter:
    try:
        node, name, value = _split_rule(rule)
        if not re.fullmatch(_PARAMETER_NAME, name):
            raise ConfigurationError(
                f"parameter name must be alphanumerics, '_', '/' and single dots: '{name}'"
            )
    except ConfigurationError as error:
        raise ConfigurationError(
            f"Couldn't parse parameter override rule: '{flag} {rule}'. Error: {error}"
        ) from None
    return Parameter(name, value, node)


def _split_rule(rule: str) -> tuple[str | None, str, str]:
    """Node, left and right side of `[node:]left:=right`."""
    left, separator, right = rule.partition(":=")
    if not separator:
        raise ConfigurationError("expected ':=' between two names")
    node, colon, name = left.rpartition(":")
    if colon:
        names.validate_node_name(node)
    if not name or not right:
        raise ConfigurationError(f"nothing stands {'after' if name else 'before'} ':='")
    return node or None, name, right


def _parse_log_level(flag: str, value: str) -> LogLevel:
    logger, separator, severity = value.rpartition(":=")
    problem = None
    if separator and not logger:
        problem = "no logger stands before ':='"
    elif severity.upper() not in _LOG_LEVELS:
        problem = f"'{severity}' is no severity ({', '.join(_LOG_LEVELS).lower()})"
    if problem is not None:
        raise ConfigurationError(f"Couldn't parse log level: '{flag} {value}'. Error: {problem}")
    return LogLevel(severity.upper(), logger)


def _parse_switch(argument: str) -> tuple[str, bool] | None:
    for prefix, on in (("--enable-", True), ("--disable-", False)):
        if argument.startswith(prefix):
            return argument.removeprefix(prefix), on
    return None

"""Texts of people and files: configuration, parameters, arguments, names, definitions, messages in YAML.

Each has one error for all mistakes; any other exception is a fault.
"""

import io
from collections.abc import Callable
from contextlib import suppress
from typing import Any, ClassVar

import msgspec

from bus import names
from bus.errors import ConfigurationError
from bus.msg.geometry_msgs import PoseStamped
from bus.msg.std_msgs import Float64MultiArray, String
from bus.parameters.file import overrides, parse_file, parse_typed, parse_value
from bus.process.ros_args import Arguments, Parameter
from bus.types import idl
from bus.types.schema import build, describe
from bus.types.support import type_support
from bus_cli.documents import load as load_document
from bus_cli.documents import split
from bus_cli.fields import FieldPath
from bus_cli.filter import compile_filter
from bus_cli.output import CommandError
from bus_cli.populate import Prototype
from bus_cli.render import View, to_yaml
from busd.config.file import load
from busd.core.access import ACTIONS, Access, Subject
from busd.core.broker import Broker
from busd.core.limits import rules_for
from fuzz.script import Script


class Anything(msgspec.Struct):
    """A message with fields of all kinds."""

    __type_name__: ClassVar[str] = "fuzz/msg/Anything"

    any: Any = None
    flags: list[bool] = []
    names: dict[str, int] = {}
    pair: tuple[int, str] = (0, "")
    either: int | str | None = None
    octets: bytes = b""
    inner: String = msgspec.field(default_factory=String)
    strings: list[str] = []
    ratio: float = 0.0


_MESSAGES: tuple[type[msgspec.Struct], ...] = (Anything, String, PoseStamped, Float64MultiArray)


class _File:
    """A replacement for a path."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def open(self, mode: str) -> io.BytesIO:
        assert mode == "rb"
        return io.BytesIO(self._content)

    def __str__(self) -> str:
        return "busd.toml"


def configuration(data: bytes) -> None:
    """busd.toml: a configuration for a broker, or a ConfigurationError that names the file."""
    try:
        loaded = load(_File(data))  # type: ignore[arg-type]
    except ConfigurationError as error:
        assert str(error).startswith("busd.toml: ")
        return
    access = Access(0, loaded.access)
    Broker(loaded.limits, loaded.topics, access)
    for topic in ("/a", "/scan", "/robot/camera_1/image"):
        rules_for(topic, loaded.topics)
        for action in ACTIONS:
            access.decide(Subject(1000, frozenset({1000})), action, topic)


def parameters(data: bytes) -> None:
    """A file of parameters, and a value as after -p or as typed for a tool."""
    text = data.decode(errors="replace")
    with suppress(ConfigurationError):
        sections = parse_file(text, "file.yaml")
        for name, value in overrides(sections, "/robot/wheels").items():
            assert isinstance(name, str)
            _check_value(value)
    with suppress(ConfigurationError):
        _check_value(parse_value(text))
    _check_value(parse_typed(text))


def _check_value(value: Any) -> None:
    kinds = {type(item) for item in value} if isinstance(value, list) else {type(value)}
    assert len(kinds) <= 1
    assert kinds <= {bool, int, float, str}


def arguments(data: bytes) -> None:
    """A command line; zero bytes end its parts, as in the kernel."""
    argv = [part.decode(errors="surrogateescape") for part in data.split(b"\0")]
    with suppress(ConfigurationError):
        parsed = Arguments.parse(argv)
        for one in parsed.parameters:
            if isinstance(one, Parameter):
                with suppress(ConfigurationError):
                    _check_value(parse_value(one.value))
        node = parsed.node_name("node")
        namespace = parsed.namespace("/ns", node)
        names.validate_full_topic_name(parsed.topic("/ns/chatter", node, namespace))
        names.validate_full_topic_name(parsed.service("/ns/add", node, namespace))


def topic_names(data: bytes) -> None:
    """Names: refused with the position of the mistake, or valid in all later steps."""
    parts = data.decode(errors="replace").split("\0")
    name, node, namespace = [*parts, "", "", ""][:3]
    checks: tuple[Callable[[str], None], ...] = (
        names.validate_topic_name,
        names.validate_full_topic_name,
        names.validate_node_name,
        names.validate_namespace,
    )
    for check in checks:
        for text in (name, node, namespace):
            try:
                check(text)
            except ConfigurationError as error:
                assert error.index is not None
                assert 0 <= error.index <= len(text)
                lines = str(error).splitlines()
                assert lines[-1].endswith("^")
    with suppress(ConfigurationError):
        names.validate_full_topic_name(names.expand_topic_name(name, node, namespace))
    with suppress(ConfigurationError):
        names.validate_namespace(names.absolute_namespace(namespace))


def definitions(data: bytes) -> None:
    """The text of a .msg, .srv or .action file."""
    text = data.decode(errors="replace")
    with suppress(ConfigurationError):
        for found in idl.parse_message(text, "fuzz/msg/Fuzz").fields:
            assert names._is_word(found.name)
    with suppress(ConfigurationError):
        idl.parse_service(text, "fuzz/srv/Fuzz")
    with suppress(ConfigurationError):
        idl.parse_action(text, "fuzz/action/Fuzz")
    with suppress(ConfigurationError):
        idl.parse_message("", text)


def documents(data: bytes) -> None:
    """Input of `bus topic pub`: messages that can be published and shown, or a CommandError."""
    kind = _MESSAGES[data[0] % len(_MESSAGES)] if data else Anything
    support = type_support(kind)
    for document in split(io.StringIO(data[1:].decode(errors="replace"))):
        try:
            prototype = Prototype(kind, load_document(document))
        except CommandError as error:
            assert len(str(error)) < 10_000, "an error that fills the screen"
            continue
        prototype.stamp()
        message = support.decode(support.encode(prototype.message))
        to_yaml(View().plain(support.schema, support.schema["root"], message))


def expressions(data: bytes) -> None:
    """Paths into messages (--field) and filters (--filter)."""
    text = data.decode(errors="replace")
    support = type_support(Anything)
    message = Anything(any={"a": [1, "x"]}, flags=[True], names={"a": 1}, octets=b"abc", strings=["", "y"])
    with suppress(CommandError):
        FieldPath(text, support.schema).pick(message)
    with suppress(CommandError):
        compile_filter(text)(message)


def schemas(data: bytes) -> None:
    """A type that another process describes: a class with readable messages, or an error."""
    script = Script(data)
    payload = script.take(script.byte() % 64)
    decoders: tuple[Callable[[bytes], Any], ...] = (msgspec.json.decode, msgspec.msgpack.decode)
    decode = script.choose(decoders)
    try:
        schema = decode(script.rest())
    except (ValueError, RecursionError):
        return
    try:
        cls = build(schema)
    except ConfigurationError:
        return
    decoder = msgspec.msgpack.Decoder(cls)
    messages: list[Any] = []
    with suppress(ValueError, RecursionError):  # msgspec's errors and bad UTF-8 are ValueErrors
        messages.append(decoder.decode(payload))
    with suppress(TypeError):  # a required field
        messages.append(cls())
    described = describe(cls)
    for message in messages:
        _show(described, message)


def _show(schema: Any, message: Any) -> None:
    for view in (View(), View(truncate_length=2, octets=True), View(no_arr=True, no_str=True)):
        to_yaml(view.plain(schema, schema["root"], message))

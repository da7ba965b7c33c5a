"""The native classes of messages and services by name: from bus.msg and bus.srv, or made of definitions.

Owns: one class for each name, and the Python type of each field of a definition. Must not know: the places of
definitions (bus.types.definitions), hashes, topics.
"""

from __future__ import annotations

from functools import cache, partial
from importlib import import_module
from threading import RLock
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgspec
from msgspec import Meta, Struct

from bus import msg
from bus.errors import ConfigurationError
from bus.msg import _types
from bus.types.definitions import check_size, find_message, find_path, is_shipped
from bus.types.schema_form import is_type_name, zero

if TYPE_CHECKING:
    from bus.srv import Service
    from bus.types.idl import Field, Message, Type

__all__ = ["described_service", "find_class", "message_class", "service_class"]

_OF_EACH_NODE: Final = ("rcl_interfaces", "type_description_interfaces")
"""Packages of the messages that every node of rclpy has; descriptions of some are precomputed."""

_lock: Final = RLock()
_classes: Final[dict[str, type[Struct]]] = {}
_open: Final[list[str]] = []


def message_class(name: str) -> type[Struct]:
    """The native class of a message, or of a part of a service or action: a single one in a process.

    It is a class of bus.msg or bus.srv if there is one, else made of the definition. Raises
    ConfigurationError as `find_definition` does, for nested types too.
    """
    with _lock:
        if name not in _classes:
            if not is_type_name(name):
                raise ConfigurationError(f"unknown interface '{name}'")
            if name in _open:
                raise ConfigurationError(f"{name} contains itself: {' -> '.join([*_open, name])}")
            _open.append(name)
            try:
                _classes[name] = _ready_made(name) or _make(find_message(name))
            finally:
                _open.pop()
        return _classes[name]


@cache
def service_class(name: str) -> type[Service]:
    """The native class of a service, found like a message's by `message_class`, with the same errors."""
    from bus import srv

    package, _, short = name.partition("/srv/")
    if package in srv.PACKAGES:
        ready: Any = getattr(import_module(f"bus.srv.{package}"), short, None)
        if getattr(ready, "__type_name__", None) == name:
            made: type[Service] = ready
            return made
    return srv.make_service(name, message_class(f"{name}_Request"), message_class(f"{name}_Response"))


def described_service(name: str) -> tuple[tuple[str, bytes], tuple[str, bytes]] | None:
    """Hash and description of a service's requests and answers; None if they are not precomputed."""
    package = name.partition("/")[0]
    if package not in _OF_EACH_NODE or not is_shipped(package):
        return None
    from bus.srv._described import DESCRIBED

    return DESCRIBED.get(name)


def find_class(name: str) -> type[Struct] | None:
    """The native class of `std_msgs/msg/String` (or `std_msgs/String`); None if there is no such message.

    Raises ConfigurationError if its definition is malformed.
    """
    if name.count("/") == 1:
        name = name.replace("/", "/msg/")
    if "/msg/" not in name or not is_type_name(name):
        return None
    return _ready_made(name) or (message_class(name) if find_path(name) else None)


def _ready_made(name: str) -> type[Struct] | None:
    package, kind, rest = name.split("/")
    found: Any = None
    if kind == "msg" and package in msg.PACKAGES:
        found = getattr(import_module(f"bus.msg.{package}"), rest, None)
    elif kind == "srv":
        from bus import srv

        if package in srv.PACKAGES:
            service, _, part = rest.rpartition("_")
            found = getattr(getattr(import_module(f"bus.srv.{package}"), service, None), part, None)
    # A module also holds the classes that it imported from its neighbours.
    ready: type[Struct] | None = found if getattr(found, "__type_name__", None) == name else None
    return ready


def _make(message: Message) -> type[Struct]:
    package, kind, short = message.name.split("/")
    described = None
    if package in _OF_EACH_NODE and is_shipped(package):
        from bus.msg._described import DESCRIBED

        described = DESCRIBED.get(message.name)
    return msgspec.defstruct(
        short,
        [(field.name, *_annotation_and_default(message.name, field)) for field in message.fields],
        bases=(_types.Message,),
        namespace={
            "__type_name__": message.name,
            "__described__": described,
            **{constant.name: constant.value for constant in message.constants},
        },
        module=f"{package}.{kind}",
        kw_only=True,
    )


def _annotation_and_default(owner: str, field: Field) -> tuple[Any, Any]:
    type_ = field.type
    base = type_.base
    if base == "wstring" or type_.string_bound is not None:
        inner: Any = Annotated[str, Meta(max_length=type_.string_bound, extra={"ros": base})]
        base = "string"
    else:
        inner = _types.PRIMITIVES.get(base) or message_class(base)
    if not type_.array:
        if "/" in base:
            return inner, msgspec.field(default_factory=inner)
        return inner, zero(base, {}) if field.default is None else field.default
    least = type_.size if type_.array == "fixed" else 0
    check_size(owner, field)
    if base in ("uint8", "byte"):
        value = bytes(least) if field.default is None else _joined(field.default)
        return _limited(bytes, _types.PRIMITIVES[f"{base}[]"], type_, {"ros": f"{base}[]"}), value
    annotation = _limited(list[inner], list[inner], type_, None)
    if field.default is not None:
        return annotation, msgspec.field(default_factory=partial(list, field.default))
    if not least:
        return annotation, msgspec.field(default_factory=list)
    if "/" in base:
        # bus.types.schema relies on a constant result of this factory.
        fill = partial(zero, ["list", base, least, least], {base: inner})
        return annotation, msgspec.field(default_factory=fill)
    return annotation, msgspec.field(default_factory=partial(list, (zero(base, {}),) * least))


def _limited(bare: Any, unlimited: Any, type_: Type, extra: dict[str, str] | None) -> Any:
    if type_.array == "unbounded":
        return unlimited
    least = type_.size if type_.array == "fixed" else None
    return Annotated[bare, Meta(min_length=least, max_length=type_.size, extra=extra)]


def _joined(values: tuple[Any, ...]) -> bytes:
    return b"".join(value if isinstance(value, bytes) else bytes((value,)) for value in values)

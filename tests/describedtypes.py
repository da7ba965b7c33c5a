"""A part of `make messages`: the modules `_described` of bus.msg and bus.srv.

Made from the ready-made message classes, and from further messages of each rclpy node. A test fails if it was
forgotten.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from bus.msg import PACKAGES, Message
from bus.parameters.messages import SERVICES as PARAMETER_SERVICES
from bus.types.classes import message_class, service_class
from bus.types.hash import schema_hash
from bus.types.schema import describe, type_name
from bus.types.service import ServiceSupport

_BUS = Path(__file__).parents[1] / "clients" / "bus"
MODULE, SERVICE_MODULE = (_BUS / kind / "_described.py" for kind in ("msg", "srv"))
HEAD = '''\
"""Hash and description of classes, so that no program works them out at its start: all of bus.msg, and more.

Made by `make messages`.
"""
# ruff: noqa: E501

from typing import Final

DESCRIBED: Final[dict[str, tuple[str, bytes]]] = {
'''

SERVICE_HEAD = '''\
"""Hash and description of what travels for the services that each node of rclpy has: requests, answers.

Made by `make messages`.
"""

from typing import Final

DESCRIBED: Final[dict[str, tuple[tuple[str, bytes], tuple[str, bytes]]]] = {
'''
SERVICES = (
    *(f"rcl_interfaces/srv/{name}" for name in PARAMETER_SERVICES),
    "type_description_interfaces/srv/GetTypeDescription",
)


def ready_made() -> list[type[Message]]:
    """Every message class of bus.msg."""
    modules = [import_module(f"bus.msg.{package}") for package in PACKAGES]
    return [getattr(module, name) for module in modules for name in module.__all__]


def all_messages() -> list[type[Any]]:
    """The classes in the module for messages: ready-made ones, and further messages of each rclpy node."""
    return [*ready_made(), message_class("rcl_interfaces/msg/ParameterEvent")]


def described(cls: type[Any]) -> tuple[str, bytes]:
    """Hash and description, computed from the class."""
    schema = describe(cls)
    return schema_hash(schema), msgspec.msgpack.encode(schema)


def source() -> str:
    """The text of the module."""
    parts = [HEAD]
    for cls in all_messages():
        hash_, description = described(cls)
        parts.append(
            f'    "{type_name(cls)}": (\n        "{hash_}",\n        {_literal(description)},\n    ),\n'
        )
    return "".join([*parts, "}\n"])


def service_source() -> str:
    """The text of the module for services."""
    parts = [SERVICE_HEAD]
    for name in SERVICES:
        support = ServiceSupport(service_class(name))  # for a native class, which is described again
        parts.append(f'    "{name}": (\n')
        for envelope in (support.requests, support.replies(b"")):
            parts.append(
                f'        (\n            "{envelope.hash}",\n            {_literal(envelope.description)},\n'
                "        ),\n"
            )
        parts.append("    ),\n")
    return "".join([*parts, "}\n"])


def _literal(data: bytes) -> str:
    """The literal in ruff's style."""
    text = repr(data)
    return text if b'"' in data else f'b"{text[2:-1]}"'


if __name__ == "__main__":
    MODULE.write_text(source())
    SERVICE_MODULE.write_text(service_source())

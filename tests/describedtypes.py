"""A part of `make messages`: clients/bus/msg/_described.py, made of the ready-made message classes.

A test says so where it was forgotten.
"""

from importlib import import_module
from pathlib import Path

import msgspec

from bus.msg import PACKAGES, Message
from bus.types.hash import schema_hash
from bus.types.schema import describe, type_name

MODULE = Path(__file__).parents[1] / "clients" / "bus" / "msg" / "_described.py"
HEAD = '''\
"""Hash and description of each class of bus.msg, so that no program works them out at its start.

Made by `make messages`.
"""
# ruff: noqa: E501

from typing import Final

DESCRIBED: Final[dict[str, tuple[str, bytes]]] = {
'''


def ready_made() -> list[type[Message]]:
    """Every class of bus.msg that stands for a message."""
    modules = [import_module(f"bus.msg.{package}") for package in PACKAGES]
    return [getattr(module, name) for module in modules for name in module.__all__]


def described(cls: type[Message]) -> tuple[str, bytes]:
    """What the class itself says, worked out."""
    schema = describe(cls)
    return schema_hash(schema), msgspec.msgpack.encode(schema)


def source() -> str:
    """The text of the module."""
    parts = [HEAD]
    for cls in ready_made():
        hash_, description = described(cls)
        parts.append(
            f'    "{type_name(cls)}": (\n        "{hash_}",\n        {_literal(description)},\n    ),\n'
        )
    return "".join([*parts, "}\n"])


def _literal(data: bytes) -> str:
    """As ruff writes it."""
    text = repr(data)
    return text if b'"' in data else f'b"{text[2:-1]}"'


if __name__ == "__main__":
    MODULE.write_text(source())

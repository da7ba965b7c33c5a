"""`make messages`: the modules of bus.msg and bus.srv, made from the definitions in clients/bus/share.

Run it after adding or changing a definition; a test fails if it was forgotten. The comment at the head of a
definition becomes the docstring of its class.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from bus import msg, srv
from bus.types.idl import Constant, Field, Message, Type, parse_message, parse_service
from bus.types.schema_form import zero

BUS = Path(__file__).parents[1] / "clients" / "bus"
ABOUT = {
    "msg/builtin_interfaces": "builtin_interfaces of ROS 2 Jazzy: time.",
    "msg/geometry_msgs": "geometry_msgs of ROS 2 Jazzy: points, poses, velocities, forces. Units are SI.",
    "msg/nav_msgs": "nav_msgs of ROS 2 Jazzy: maps, paths and odometry.",
    "msg/rcl_interfaces": "rcl_interfaces of ROS 2 Jazzy, as far as the bus itself needs them: the log.",
    "msg/sensor_msgs": "sensor_msgs of ROS 2 Jazzy: what sensors measure. Units are SI.",
    "msg/std_msgs": "std_msgs of ROS 2 Jazzy: single values, arrays and the header.",
    "srv/example_interfaces": "example_interfaces of ROS 2 Jazzy: its services.",
    "srv/std_srvs": "std_srvs of ROS 2 Jazzy.",
}
ONLY = {"msg/rcl_interfaces": {"Log"}}
"""Packages of which only some definitions have a class here."""

LINE = 110


class Definition(NamedTuple):
    """The content of one file: one message, or the request and the response of a service."""

    name: str
    about: str
    parts: tuple[Message, ...]


class Code(NamedTuple):
    """Lines of classes, and the names that they use, each with its module."""

    lines: list[str]
    used: set[tuple[str, str]]


def modules() -> dict[Path, str]:
    """The files to write, and the text of each."""
    listed = [("msg", package) for package in msg.PACKAGES] + [("srv", package) for package in srv.PACKAGES]
    return {BUS / kind / f"{package}.py": source(kind, package) for kind, package in listed}


def source(kind: str, package: str) -> str:
    """The text of the module of a package: `msg`, `std_msgs`."""
    found = definitions(kind, package)
    code = Code([], set())
    for definition in found.values() if kind == "srv" else in_order(found):
        code.lines.extend(["", ""])
        if kind == "srv":
            _service(code, definition)
        else:
            _class(code, definition.name, definition.about, definition.parts[0])
    if kind == "srv":
        code.used.add(("bus.srv", "Service"))
    here = f"bus.{kind}.{package}"
    head = [f'"""{ABOUT[f"{kind}/{package}"]}', "", "Made by `make messages`.", '"""', ""]
    imports = _imports({(module, name) for module, name in code.used if module != here})
    names = [f'    "{name}",' for name in found]
    return "\n".join([*head, *imports, "", "__all__ = [", *names, "]", *code.lines, ""])


def definitions(kind: str, package: str) -> dict[str, Definition]:
    """The definitions of a package, by the names of their classes, in ruff's order."""
    only = ONLY.get(f"{kind}/{package}")
    paths = [path for path in (BUS / "share" / package / kind).iterdir() if not only or path.stem in only]
    return {path.stem: _read(path) for path in sorted(paths, key=lambda path: _key(path.stem))}


def in_order(found: dict[str, Definition]) -> Iterator[Definition]:
    """Sorted: a message comes after the messages that it contains."""
    done: set[str] = set()

    def after_its_parts(definition: Definition) -> Iterator[Definition]:
        if definition.name not in done:
            done.add(definition.name)
            for field in definition.parts[0].fields:
                package, _, name = field.type.base.rpartition("/")
                if package == definition.parts[0].name.rpartition("/")[0]:
                    yield from after_its_parts(found[name])
            yield definition

    for definition in found.values():
        yield from after_its_parts(definition)


def _read(path: Path) -> Definition:
    text, kind = path.read_text(), path.suffix[1:]
    name = f"{path.parents[1].name}/{kind}/{path.stem}"
    comment = re.match(r"(?:#.*\n)+", text)
    if comment is None:
        raise ValueError(f"{path}: it must begin with a comment that says what it is")
    about = " ".join(line[1:].strip() for line in comment[0].splitlines())
    parts = (parse_message(text, name),) if kind == "msg" else parse_service(text, name)[1:]
    return Definition(path.stem, about, parts)


def _service(code: Code, definition: Definition) -> None:
    code.lines.extend([f"class {definition.name}(Service):", f'    """{definition.about}"""'])
    for part in definition.parts:
        code.lines.append("")
        _class(code, part.name.rpartition("_")[2], "", part, "    ")


def _class(code: Code, name: str, about: str, message: Message, indent: str = "") -> None:
    code.used.add(("bus.msg._types", "Message"))
    code.lines.append(f"{indent}class {name}(Message, kw_only=True):")
    constants = [_constant(code, one) for one in message.constants]
    fields = [_field(code, one) for one in message.fields]
    blocks = [block for block in ([f'"""{about}"""'] if about else [], constants, fields) if block]
    for at, block in enumerate(blocks or [["pass"]]):
        code.lines.extend([""] * bool(at) + [f"{indent}    {line}" for line in block])


def _constant(code: Code, constant: Constant) -> str:
    code.used.add(("typing", "ClassVar"))
    return f"{constant.name}: ClassVar[{type(constant.value).__name__}] = {_literal(constant.value)}"


def _field(code: Code, field: Field) -> str:
    type_ = field.type
    if type_.string_bound is not None or type_.array == "bounded" or (type_.array and field.default):
        raise ValueError(f"{field.name}: bounds, and defaults of arrays, are not written yet")
    if type_.array == "fixed":
        return _fixed(code, field.name, type_)
    if type_.array and type_.base in ("uint8", "byte"):
        return f'{field.name}: {_name(code, f"{type_.base}_array")} = b""'
    element = _name(code, type_.base)
    if not type_.array and "/" not in type_.base:
        value = zero(type_.base, {}) if field.default is None else field.default
        return f"{field.name}: {element} = {_literal(value)}"
    code.used.add(("msgspec", "field"))
    if type_.array:
        return f"{field.name}: list[{element}] = field(default_factory=list)"
    return f"{field.name}: {element} = field(default_factory={element})"


def _fixed(code: Code, name: str, type_: Type) -> str:
    if type_.base != "float64":
        raise ValueError(f"{name}: arrays of a fixed size are written of float64 only")
    code.used.update({("msgspec", "field"), ("bus.msg._types", "zeros")})
    annotation = _name(code, f"{type_.base}_{type_.size}")
    return f"{name}: {annotation} = field(default_factory=zeros({type_.size}))"


def _name(code: Code, base: str) -> str:
    """The name of a type in a module."""
    package, _, name = base.rpartition("/msg/")
    if base != "bool":
        code.used.add((f"bus.msg.{package}" if package else "bus.msg._types", name))
    return name


def _literal(value: object) -> str:
    """The literal in ruff's style."""
    text = repr(value)
    return text if not isinstance(value, str | bytes) or '"' in text else text.replace("'", '"')


def _imports(used: set[tuple[str, str]]) -> Iterator[str]:
    modules = sorted({module for module, _ in used}, key=lambda module: (module.startswith("bus"), module))
    for group in ("typing", "msgspec", "bus"):
        of_group = [module for module in modules if module.partition(".")[0] == group]
        for module in of_group:
            yield from _import(module, sorted((name for one, name in used if one == module), key=_key))
        if of_group and group != "bus":
            yield ""


def _import(module: str, names: Iterable[str]) -> Iterator[str]:
    line = f"from {module} import {', '.join(names)}"
    if len(line) <= LINE:
        yield line
    else:
        yield from (f"from {module} import (", *(f"    {name}," for name in names), ")")


def _key(name: str) -> tuple[bool, list[str | int]]:
    """The sort key: classes first, and 8 before 16."""
    return name[0].islower(), [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


if __name__ == "__main__":
    for path, text in modules().items():
        path.write_text(text)

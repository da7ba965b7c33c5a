"""Finds interface definitions by name: their files, and their contents.

Owns: the places of definitions. Must not know: the grammar (`idl`), classes made of definitions.

A definition is `<package>/{msg,srv,action}/<Name>.{msg,srv,action}`. It is searched in

    the share folders of $AMENT_PREFIX_PATH
    the colcon workspace (or the package) around the current directory, then around the program's folder
    the folders of $BUS_INTERFACE_PATH
    the definitions of ROS 2 that come with this package
"""

# Paths are texts: pathlib takes several times as long for each, and its import takes milliseconds.
# ruff: noqa: PTH109, PTH112, PTH113, PTH118, PTH119, PTH120, PTH123, PTH208
from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

from bus.errors import ConfigurationError
from bus.types.schema_form import is_type_name

if TYPE_CHECKING:
    from pathlib import Path

    from bus.types import idl

__all__ = [
    "KINDS",
    "check_size",
    "definition_path",
    "exists",
    "find_definition",
    "find_message",
    "find_path",
    "full_name",
    "is_shipped",
    "names",
    "packages",
]

Kind: TypeAlias = Literal["msg", "srv", "action"]
KINDS: Final[tuple[Kind, ...]] = ("msg", "srv", "action")

_SHIPPED: Final = os.path.join(os.path.dirname(os.path.dirname(__file__)), "share")
_PACKAGE_NAME: Final = re.compile(rb"<name>\s*(\w+)\s*</name>")
_IGNORED: Final = frozenset(("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE"))
_NO_WORKSPACES: Final = frozenset(("/", "/usr", "/usr/local"))
_MAX_FIXED: Final = 2**24
_MAX_DEPTH: Final = 5
_MAX_FOLDERS: Final = 5000
"""Most folders searched below `src`, which may not belong to a workspace at all."""


def find_definition(name: str) -> idl.Message | idl.Service | idl.Action:
    """The definition of `std_msgs/msg/String`, `std_srvs/srv/SetBool` or the like.

    Raises ConfigurationError if it is missing or malformed, or names a type that doesn't exist. A fault in
    another definition raises only when that definition is requested.
    """
    return _load(_found(name), name)


def exists(name: str) -> bool:
    """Whether there is a file for a definition that `find_definition` or `find_message` returns.

    Takes a hundredth of the time of their error for a missing one, which suggests similar names.
    """
    from bus.types.idl import CARRIERS, PARTS

    if find_path(name) is not None:
        return True
    package, _, rest = name.partition("/")
    whole, _, part = rest.partition("_")
    kind = whole.partition("/")[0]
    made = {"srv": ("Event",), "action": CARRIERS}.get(kind, ())
    return (part in PARTS.get(kind, ()) or part in made) and find_path(f"{package}/{whole}") is not None


def find_message(name: str) -> idl.Message:
    """The definition of a message, or of a part of a service or an action: `std_srvs/srv/SetBool_Request`.

    It also finds messages with an action's parts, `example_interfaces/action/Fibonacci_FeedbackMessage`, and
    the event of a service, `std_srvs/srv/SetBool_Event`. Raises ConfigurationError as `find_definition`.
    """
    from bus.types.idl import CARRIERS, PARTS, Action, Message, Service, carriers, event_of

    package, kind, short = name.split("/") if name.count("/") == 2 else ("", "", name)
    whole, _, part = short.partition("_")
    if part in PARTS.get(kind, ()):
        found: idl.Message = getattr(find_definition(f"{package}/{kind}/{whole}"), part.lower())
        return found
    if kind == "srv" and part == "Event":
        service = find_definition(f"{package}/{kind}/{whole}")
        assert isinstance(service, Service)
        return event_of(service)
    if kind == "action" and part in CARRIERS:
        action = find_definition(f"{package}/{kind}/{whole}")
        assert isinstance(action, Action)
        return carriers(action)[part]
    definition = find_definition(name)
    if isinstance(definition, Message):
        return definition
    parts = " or ".join(f"{name}_{part}" for part in PARTS[kind])
    raise ConfigurationError(f"{name} is no message; say {parts}")


def definition_path(name: str) -> Path:
    """The file of a definition. Raises ConfigurationError if there is none."""
    from pathlib import Path

    return Path(_found(name))


def check_size(owner: str, field: idl.Field) -> None:
    """Raise ConfigurationError for an array with a fixed size too large for a default value."""
    if field.type.array == "fixed" and field.type.size > _MAX_FIXED:
        raise ConfigurationError(f"{owner}: '{field.name}' is too large for an array of a fixed size")


def full_name(name: str) -> str:
    """`std_msgs/String` as `std_msgs/msg/String`: the first kind with that name, else a message."""
    package, _, rest = name.partition("/")
    if not rest or "/" in rest:
        return name
    found = [f"{package}/{kind}/{rest}" for kind in KINDS if find_path(f"{package}/{kind}/{rest}")]
    return found[0] if found else f"{package}/msg/{rest}"


def is_shipped(package: str) -> bool:
    """Whether the definitions of a package come with busd, and no other definitions are found before them."""
    return next(_existing(package), None) == os.path.join(_SHIPPED, package)


def packages() -> list[str]:
    """The packages that have definitions, sorted."""
    return sorted({name.partition("/")[0] for name in names()})


def names(kind: Kind | None = None, package: str | None = None) -> list[str]:
    """The full names of all definitions (of this kind, of this package), sorted by package and kind."""
    found: set[tuple[str, int, str]] = set()
    for index, one in enumerate(KINDS):
        if kind in (None, one):
            for owner, folder in _folders(package):
                found |= {(owner, index, stem) for stem in _stems(os.path.join(folder, one), f".{one}")}
    return [f"{owner}/{KINDS[index]}/{stem}" for owner, index, stem in sorted(found)]


def _found(name: str) -> str:
    if (path := find_path(name)) is None:
        raise ConfigurationError(f"unknown interface '{name}'{_meant(name)}")
    return path


def _existing(package: str) -> Iterator[str]:
    return (folder for _, folder in _folders(package) if os.path.isdir(folder))


@cache
def _load(path: str, name: str) -> idl.Message | idl.Service | idl.Action:
    from bus.types import idl

    package, kind, _ = name.split("/")
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{name}.{kind}: it is no text of UTF-8: {error}") from error
    has_header = find_path(f"{package}/msg/Header") not in (None, path)
    if kind == "msg":
        message = idl.parse_message(text, name, has_header=has_header)
        _check_nested(message, path, name)
        return message
    parse = idl.parse_service if kind == "srv" else idl.parse_action
    definition = parse(text, name, has_header=has_header)
    for part in definition[1:]:
        _check_nested(part, path, name)
    return definition


def _check_nested(message: idl.Message, path: str, name: str) -> None:
    package, kind, _ = name.split("/")
    for field in message.fields:
        base = field.type.base
        if "/" in base and find_path(base) is None:
            short = base.removeprefix(f"{package}/msg/").replace("/msg/", "/")
            raise ConfigurationError(
                f"{package}/{kind}/{os.path.basename(path)}:{field.line}: '{short}' is not a known type"
                f"{_meant_by_type(base, short)}"
            )


def _meant_by_type(base: str, short: str) -> str:
    from bus.types.idl import PRIMITIVES

    if short.lower() in PRIMITIVES:
        return f"; did you mean '{short.lower()}'?"
    class_name = base.rpartition("/")[2]
    same = [name.replace("/msg/", "/") for name in names("msg") if name.endswith(f"/{class_name}")]
    return f"; did you mean '{same[0]}'?" if same else _meant(base)


def _meant(name: str) -> str:
    from bus.base.suggest import did_you_mean

    # A definition that can't be read (a folder, a broken link) is in `names`, too.
    return did_you_mean(name, (one for one in names() if one != name), 0.75)


def find_path(name: str) -> str | None:
    """The file of a definition; None if there is none."""
    if not is_type_name(name):
        return None
    package, kind, short = name.split("/")
    for _, folder in _folders(package):
        path = os.path.join(folder, kind, f"{short}.{kind}")
        if os.path.isfile(path):
            return path
    return None


def _folders(package: str | None) -> Iterator[tuple[str, str]]:
    """The folders that may hold definitions of this package (None: of any), in order of precedence."""
    environ = os.environ
    program = os.path.dirname(os.path.realpath(sys.argv[0])) if sys.argv and sys.argv[0] else ""
    try:
        here = os.getcwd()
    except OSError:
        here = ""
    paths = environ.get("AMENT_PREFIX_PATH", ""), environ.get("BUS_INTERFACE_PATH", "")
    for source in _sources(here, program, *paths):
        if isinstance(source, dict):
            yield from (item for item in source.items() if package in (None, item[0]))
        elif package is not None:
            yield package, os.path.join(source, package)
        else:
            yield from ((os.path.basename(folder), folder) for folder in _subfolders(source))


@cache
def _sources(here: str, program: str, prefixes: str, folders: str) -> list[str | dict[str, str]]:
    """Folders with packages; for a workspace, a dict with the folder of each of its packages."""
    ament = [os.path.join(prefix, "share") for prefix in prefixes.split(os.pathsep) if prefix]
    around = [_around(folder) for folder in dict.fromkeys((here, program)) if folder]
    own = [folder for folder in folders.split(os.pathsep) if folder]
    return [*ament, *around, *own, _SHIPPED]


def _around(folder: str) -> dict[str, str]:
    """The packages of the innermost workspace around a folder, or the package that contains the folder."""
    found: dict[str, str] = {}
    parent, below = folder, ""
    while parent != below:
        if parent not in _NO_WORKSPACES:
            if not found and os.path.isfile(os.path.join(parent, "package.xml")):
                found[_package_name(parent)] = parent
            source = os.path.join(parent, "src")
            if os.path.isdir(source) and (inside := dict(_search(source))):
                return found | inside
        parent, below = os.path.dirname(parent), parent
    return found


def _search(source: str) -> Iterator[tuple[str, str]]:
    folders = [(source, 0)]
    for visited, (folder, depth) in enumerate(folders):  # the list grows meanwhile
        try:
            entries = {entry.name: entry for entry in os.scandir(folder)}
        except OSError:
            continue
        if not _IGNORED.isdisjoint(entries):
            continue
        if "package.xml" in entries:
            yield _package_name(folder), folder
        elif depth < _MAX_DEPTH and visited < _MAX_FOLDERS:
            below = sorted(name for name, entry in entries.items() if entry.is_dir() and name[0] != ".")
            folders += [(os.path.join(folder, name), depth + 1) for name in below]


def _package_name(folder: str) -> str:
    try:
        with open(os.path.join(folder, "package.xml"), "rb") as file:
            found = _PACKAGE_NAME.search(file.read())
    except OSError:
        found = None
    return found[1].decode() if found else os.path.basename(folder)


def _subfolders(folder: str) -> list[str]:
    try:
        return [entry.path for entry in os.scandir(folder) if entry.is_dir()]
    except OSError:
        return []


def _stems(folder: str, suffix: str) -> list[str]:
    try:
        return [
            name.removesuffix(suffix)
            for name in os.listdir(folder)
            if name.endswith(suffix) and name != suffix
        ]
    except OSError:
        return []

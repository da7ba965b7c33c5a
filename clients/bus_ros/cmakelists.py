"""Python parts that the CMakeLists.txt of an ament_cmake package installs: programs and imported modules.

Owns: the part of CMake's language that such files use. Conditions count as true, and functions that a project
defines are unknown. Must not know: the search for packages, the start of programs.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["Installed", "read"]

_FILE = "CMakeLists.txt"
_TOKEN = re.compile(
    r"#\[(=*)\[.*?\]\1\]"  # a bracket comment
    r"|#[^\n]*"
    r"|\[(=*)\[\n?(?P<bracket>.*?)\]\2\]"
    r'|"(?P<quoted>(?:\\.|[^"\\])*)"'
    r"|(?P<paren>[()])"
    r'|(?P<bare>(?:\\.|[^\s()#"\\])+)',
    re.DOTALL,
)
_VARIABLE = re.compile(r"\$\{([^${}]*)\}")
_ESCAPED = re.compile(r"\\(.)", re.DOTALL)
_WORDS = frozenset(
    (
        *("DESTINATION", "TYPE", "PERMISSIONS", "CONFIGURATIONS", "COMPONENT", "RENAME", "OPTIONAL"),
        *("EXCLUDE_FROM_ALL", "EXPORT", "RUNTIME", "LIBRARY", "ARCHIVE", "INCLUDES"),
    )
)
"""These words end the list of files of `install`."""
_MOST_DEEP = 8


class Installed(NamedTuple):
    """The Python parts that a package installs."""

    programs: dict[str, Path]
    """The files of its programs, by their installed names."""
    compiled: set[str]
    """Its programs in other languages, which need a build."""
    python_folders: tuple[str, ...]
    """The folders from which its installed Python packages and modules are imported."""


def read(folder: Path, package: str) -> Installed | None:
    """The Python parts that the package in `folder` installs; None without a readable CMakeLists.txt."""
    reader = _Reader(package)
    return reader.found if reader.read(folder) else None


class _Reader:
    def __init__(self, package: str) -> None:
        self.found = Installed({}, set(), ())
        self._package = package
        self._folders: dict[str, None] = {}
        self._root: Path | None = None
        self._variables: dict[str, str] = {"PROJECT_NAME": package}

    def read(self, folder: Path, depth: int = 0) -> bool:
        try:
            text = (folder / _FILE).read_text("utf-8", "replace")
        except OSError:
            return False
        root = self._root = self._root or folder
        self._variables |= {
            **dict.fromkeys(("CMAKE_SOURCE_DIR", "PROJECT_SOURCE_DIR"), str(root)),
            **dict.fromkeys(("CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR"), str(folder)),
            **dict.fromkeys(("CMAKE_BINARY_DIR", "CMAKE_CURRENT_BINARY_DIR"), str(folder / "build")),
            "CMAKE_INSTALL_LIBDIR": "lib",
            "CMAKE_INSTALL_BINDIR": "bin",
        }
        for name, arguments in _commands(text):
            words = [word for argument in arguments for word in self._expand(*argument)]
            if name == "add_subdirectory" and words and depth < _MOST_DEEP:
                before = dict(self._variables)
                self.read(folder / words[0], depth + 1)
                self._variables = before
            elif words:
                self._obey(name, words, folder)
        self.found = self.found._replace(python_folders=tuple(self._folders))
        return True

    def _obey(self, name: str, words: list[str], folder: Path) -> None:
        first, *rest = words
        if name == "project":
            self._variables["PROJECT_NAME"] = first
        elif name == "set":
            kept = rest[: rest.index("CACHE")] if "CACHE" in rest else rest
            self._variables[first] = ";".join(word for word in kept if word != "PARENT_SCOPE")
        elif name == "list" and first == "APPEND" and rest:
            old = self._variables.get(rest[0], "")
            self._variables[rest[0]] = ";".join([*([old] if old else []), *rest[1:]])
        elif name == "file" and first in ("GLOB", "GLOB_RECURSE") and rest:
            self._variables[rest[0]] = ";".join(_glob(rest[1:], folder, is_deep=first == "GLOB_RECURSE"))
        elif name == "install" and first in ("PROGRAMS", "TARGETS"):
            self._install(first, rest, folder)
        elif name == "ament_python_install_package":
            place = rest[rest.index("PACKAGE_DIR") + 1] if "PACKAGE_DIR" in rest[:-1] else first
            if Path(place).name == first:  # else its import name differs from its folder
                self._folders[str((folder / place).parent)] = None
        elif name == "ament_python_install_module":
            self._folders[str((folder / first).parent)] = None

    def _install(self, kind: str, words: list[str], folder: Path) -> None:
        end = next((at for at, word in enumerate(words) if word in _WORDS), len(words))
        options = words[end:]
        # With TARGETS there may be several; the one for programs comes after RUNTIME, or is the only one.
        if kind == "TARGETS" and "RUNTIME" in options:
            options = options[options.index("RUNTIME") :]
        place = _after("DESTINATION", options)
        if place is None or Path(place.lstrip("/")).parts[:2] != ("lib", self._package):
            return
        if kind == "TARGETS":
            self.found.compiled.update(words[:end])
            return
        renamed = _after("RENAME", options)
        for word in words[:end]:
            path = folder / word
            self.found.programs[renamed or path.name] = path

    def _expand(self, text: str, is_quoted: bool) -> list[str]:
        """The words of an argument: variables are replaced, and an unquoted text is split as a list."""
        for _ in range(_MOST_DEEP):
            text, changed = _VARIABLE.subn(lambda found: self._variables.get(found[1], ""), text)
            if not changed:
                break
        words = [text] if is_quoted else [word for word in text.split(";") if word]
        return [_ESCAPED.sub(r"\1", word) for word in words]


def _commands(text: str) -> Iterator[tuple[str, list[tuple[str, bool]]]]:
    """The commands of a file: lower-case names and arguments, each with a flag for quotes."""
    name, depth = "", 0
    arguments: list[tuple[str, bool]] = []
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        if kind == "paren":
            depth += 1 if token["paren"] == "(" else -1
            if depth == 0:
                yield name, arguments
                name = ""
            if depth <= 0:
                depth, arguments = 0, []
        elif depth == 0:
            name = (token["bare"] or "").lower()
        elif kind in ("bracket", "quoted", "bare"):
            arguments.append((token[kind], kind != "bare"))


def _after(word: str, words: list[str]) -> str | None:
    at = words.index(word) + 1 if word in words else len(words)
    return words[at] if at < len(words) else None


def _glob(words: list[str], folder: Path, *, is_deep: bool) -> list[str]:
    base: Path | None = None
    if "RELATIVE" in words[:-1]:
        at = words.index("RELATIVE")
        base = folder / words[at + 1]
        words = words[:at] + words[at + 2 :]
    found: list[str] = []
    for word in words:
        if word in ("CONFIGURE_DEPENDS", "LIST_DIRECTORIES", "true", "false"):
            continue
        pattern = word.removeprefix(f"{folder}/")
        if pattern.startswith("/"):
            continue
        paths = sorted(folder.rglob(pattern) if is_deep else folder.glob(pattern))
        found += [
            str(path.relative_to(base) if base and path.is_relative_to(base) else path) for path in paths
        ]
    return found

"""The Pythons of this machine that busd is for: on PATH, of pyenv, of uv."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["LEAST", "WANTED", "Python", "find", "lacking_package", "make_venv", "missing"]

LEAST = (3, 11)
WANTED = ("3.11", "3.12", "3.13", "3.14", "3.13t", "3.14t")
"""Those that are tried where they are found; `t`: free-threaded."""

_NEWEST_MINOR = 20
_NO_PACKAGE = re.compile(
    r"(?:No matching distribution found for|Failed building wheel for|Failed to build) '?([\w.-]+)"
)
_ASK = """
import json, sys, sysconfig
kind = "t" if sysconfig.get_config_var("Py_GIL_DISABLED") else ""
print(json.dumps([sys.implementation.name, sys.version_info[:3], kind]))
"""


class Python(NamedTuple):
    """One interpreter."""

    version: tuple[int, ...]
    kind: str
    """`t`: free-threaded; ""."""
    path: Path

    @property
    def name(self) -> str:
        """As in the names of programs: 3.13, 3.13t."""
        return ".".join(map(str, self.version[:2])) + self.kind

    def why_no_core(self) -> str:
        """Why busd's native core can't be built for it; "" where it can."""
        return "the limited API needs the GIL" if self.kind else ""

    def __str__(self) -> str:
        return ".".join(map(str, self.version)) + self.kind


def find() -> list[Python]:
    """One of each version, the newest, in their order."""
    found: dict[str, Python] = {}
    for path in dict.fromkeys(_candidates()):
        python = _ask(path)
        if python and python.version >= LEAST and python > found.get(python.name, ((), "", path)):
            found[python.name] = python
    return sorted(found.values(), key=lambda python: (python.kind, python.version))


def missing(found: Iterable[Python]) -> list[str]:
    """Which of the wanted are not there."""
    names = {python.name for python in found}
    return [name for name in WANTED if name not in names]


def make_venv(python: Python, folder: Path) -> Path:
    """An empty environment, without even pip; returns its interpreter."""
    subprocess.run([python.path, "-m", "venv", "--without-pip", folder], check=True)
    return folder / "bin" / "python"


def lacking_package(said: str, version: tuple[int, ...]) -> str:
    """The package that pip could not get for a Python of this version, by its output; "" for other faults.

    For the version of this process it is always another fault: its packages are installed.
    """
    names = _NO_PACKAGE.findall(said)
    if version == sys.version_info[:3] or "busd" in names:
        return ""
    return next(iter(names), "")


def _candidates() -> Iterator[Path]:
    yield Path(sys.executable)
    for minor in range(LEAST[1], _NEWEST_MINOR):
        for kind in ("", "t"):
            if path := shutil.which(f"python3.{minor}{kind}"):
                yield Path(path)
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    yield from sorted(pyenv.glob("versions/*/bin/python"))
    if uv := shutil.which("uv"):
        words = [uv, "python", "list", "--only-installed", "--offline", "--output-format", "json"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        for entry in json.loads(done.stdout) if not done.returncode else ():
            yield Path(entry["path"])


def _ask(path: Path) -> Python | None:
    """None where it does not run (as a shim of pyenv may), or is no CPython."""
    try:
        done = subprocess.run([path, "-IS", "-c", _ASK], capture_output=True, text=True, check=False)
    except OSError:
        return None
    if done.returncode:
        return None
    implementation, version, kind = json.loads(done.stdout)
    return Python(tuple(version), kind, path) if implementation == "cpython" else None

"""busd as users have it: this tree installed with its requirements and nothing else, for one measurement.

The developers' environment finds modules by a separate finder, which costs each process about 20 ms and 2
MiB.
"""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.machine import ROOT

_PARTS = ("busd", "clients", "pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE")
_LIMIT_S = 300.0


class Installed(NamedTuple):
    """The Python with the installed busd; or this Python, and the reason why."""

    python: str
    why_not: str = ""


@contextmanager
def installed(root: Path = ROOT) -> Iterator[Installed]:
    """Install the tree at `root` into an environment that exists until the end of the block."""
    with TemporaryDirectory(prefix="busd-bench-") as name:
        yield _installed(root, Path(name))


def _installed(root: Path, folder: Path) -> Installed:
    try:
        return Installed(_install(root, folder))
    except subprocess.CalledProcessError as error:
        said = error.stderr
    except (OSError, subprocess.SubprocessError) as error:
        said = str(error)
    last = (said.strip().splitlines() or ["it does not say why"])[-1]
    return Installed(sys.executable, last.replace(str(folder), "<folder>").replace(str(root), "."))


def _install(root: Path, folder: Path) -> str:
    """Install the tree; returns the Python. Raises OSError and SubprocessError."""
    source, environment = folder / "source", folder / "environment"
    source.mkdir()
    leave_out = shutil.ignore_patterns("__pycache__", "*.so", "*.egg-info")
    for part in _PARTS:
        if (root / part).is_dir():
            shutil.copytree(root / part, source / part, ignore=leave_out)
        else:
            shutil.copy(root / part, source)
    _run(sys.executable, "-m", "venv", str(environment))
    python = str(environment / "bin" / "python")
    _run(python, "-m", "pip", "install", "-qq", "--disable-pip-version-check", str(source))
    shutil.rmtree(source)
    return python


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=_LIMIT_S)

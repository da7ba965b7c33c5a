"""The wheel for aarch64 (Raspberry Pi, Jetson): compiled by a cross compiler and tried under an emulator.

Headers and the interpreter are from Debian's packages for arm64, unpacked into a folder of the development
environment. Nothing is installed on this machine.
"""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from pythons import Python
from wheels import Missing, Wrong, building, first_use
from wheels.sources import ROOT

__all__ = ["Machine", "build", "find_machine", "try_wheel"]

_COMPILER = "aarch64-linux-gnu-gcc"
_EMULATOR = "qemu-aarch64"
_PACKAGES = ("python3-minimal", "libpython3-stdlib", "libpython3-dev")
_PROGRAM = Path(__file__).with_name("on_aarch64.py")
_EXTRAS = "[ros2,rmw-zenoh]"
"""Those that a robot's computer needs."""
_TEST_PACKAGES = ("hypothesis", "pytest", "pytest-asyncio", "pytest-timeout")
_ENGINE_TESTS = "tests/unit/bus_bridge/rtps"
"""cyclonedds has no wheel for aarch64, so there the bridge to ROS 2 runs on this engine."""


class Machine:
    """An emulated machine: the files of Debian for arm64 below `root`."""

    def __init__(self, root: Path) -> None:
        self.root = root
        found = [path for path in (root / "usr/bin").glob("python3.*") if path.name[8:].isdecimal()]
        if not found:
            raise Missing("Debian's packages for arm64 have no Python")
        self.python = found[0]

    def words(self, *arguments: str) -> list[str]:
        """The command that runs its Python."""
        return [_EMULATOR, "-L", str(self.root), str(self.python), *arguments]

    @property
    def flags(self) -> str:
        """Of the C compiler: where Python's headers are."""
        include = self.root / "usr/include"
        return f"-I{include / self.python.name} -idirafter {include}"


def find_machine(folder: Path = Path(sys.prefix, "arm64")) -> Machine:
    """The machine in `folder`, where it is made if it is not there yet. Raises Missing."""
    if platform.machine() == "aarch64":
        raise Missing("this machine is one itself, and the native wheel is for it")
    probe = (
        subprocess.run(
            [_COMPILER, "-E", "-"], input="#include <stdlib.h>", capture_output=True, text=True, check=False
        )
        if shutil.which(_COMPILER)
        else None
    )
    if probe is None or probe.returncode:
        raise Missing(
            f"no {_COMPILER} with a C library (Debian: gcc-aarch64-linux-gnu libc6-dev-arm64-cross)"
        )
    if not shutil.which(_EMULATOR):
        raise Missing(f"no {_EMULATOR} (Debian: qemu-user)")
    if not (folder / "complete").exists():
        _unpack(folder)
        (folder / "complete").touch()
    return Machine(folder / "root")


def build(sdist: Path, machine: Machine, folder: Path) -> Path:
    """The wheel of the sources in `sdist`, for every aarch64 with a glibc that has the symbols used."""
    return building.build_native(sdist, folder, f"{_COMPILER} {machine.flags}", "linux-aarch64")


def try_wheel(wheel: Path, native: Path, python: Python, machine: Machine, folder: Path) -> str:
    """Use it on the emulated machine, where that machine's pip installs it with all that it needs.

    By itself, with a process that has `native` on this one, and by the tests of the engine that bridges to
    ROS 2. Returns what was seen. Raises Wrong.
    """
    _install(wheel, machine, folder)
    here = first_use.Environment(python, folder / "here")
    here.install(str(native))
    variables = {**here.variables, "PYTHONPATH": str(folder / "site")}
    here.run("bus", "daemon", "start")
    try:
        said = [_run(machine.words(str(_PROGRAM), "alone"), Wrong, variables)]
        for first, second in (("talk", "listen"), ("listen", "talk")):
            with subprocess.Popen(
                [here.bin / "python", _PROGRAM, first], env=here.variables, stdout=subprocess.PIPE, text=True
            ) as other:
                said.append(_run(machine.words(str(_PROGRAM), second), Wrong, variables))
                said.append(other.communicate(timeout=first_use.PATIENCE_S)[0])
            if other.returncode:
                raise Wrong(f"beside aarch64, {_PROGRAM.name} {first} ended with {other.returncode}:\n{said}")
    finally:
        here.run("bus", "daemon", "stop")
    return "".join([*said, _test_engine(machine, folder / "tree", variables)])


def _install(wheel: Path, machine: Machine, folder: Path) -> None:
    """Install it, its extras, and the packages of tests into `folder`/site, by pip on that machine."""
    found = importlib.util.find_spec("pip")
    assert found is not None and found.origin is not None
    alone = folder / "pip"  # without the other packages of this environment
    alone.mkdir(parents=True)
    (alone / "pip").symlink_to(Path(found.origin).parent)
    options = ("-qq", "--no-compile", "--only-binary=:all:", "--target", str(folder / "site"))
    words = ["-m", "pip", "--disable-pip-version-check", "install", "--root-user-action=ignore", *options]
    variables = {**os.environ, "LC_ALL": "C", "PYTHONPATH": str(alone)}
    _run(machine.words(*words, f"{wheel}{_EXTRAS}", *_TEST_PACKAGES), Wrong, variables)


def _test_engine(machine: Machine, tree: Path, variables: dict[str, str]) -> str:
    """Run the engine's tests beside nothing but the installed packages; returns the result."""
    shutil.copytree(ROOT / "tests", tree / "tests", ignore=shutil.ignore_patterns("__pycache__", "build"))
    shutil.copy(ROOT / "pyproject.toml", tree)
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", str(tree / _ENGINE_TESTS))
    said = _run(machine.words(*words), Wrong, variables)
    return f"aarch64, {_ENGINE_TESTS}: {said.splitlines()[-1]}\n"


def _unpack(folder: Path) -> None:
    """Download the packages and their dependencies, and unpack them below `folder`/root. Raises Missing."""
    if not shutil.which("apt-get") or not shutil.which("dpkg-deb"):
        raise Missing("no apt-get, for Debian's Python for arm64")
    print(f"unpacking Debian's Python for arm64 into {folder}: half a minute, 130 MB", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("lists/partial", "cache/archives/partial", "root"):
        (folder / name).mkdir(parents=True)
    (folder / "status").touch()
    settings = {
        "APT::Architecture": "arm64",
        "APT::Architectures": "arm64",
        "APT::Sandbox::User": "root",
        "Debug::NoLocking": "1",
        "Dir::Cache": folder / "cache",
        "Dir::State::lists": folder / "lists",
        "Dir::State::status": folder / "status",
    }
    apt = ["apt-get", "-qq", *(word for key, value in settings.items() for word in ("-o", f"{key}={value}"))]
    _run([*apt, "update"], Missing)
    _run([*apt, "install", "--yes", "--download-only", "--no-install-recommends", *_PACKAGES], Missing)
    for package in sorted((folder / "cache/archives").glob("*.deb")):
        _run(["dpkg-deb", "--extract", str(package), str(folder / "root")], Missing)
    for name in ("lists", "cache"):
        shutil.rmtree(folder / name)


def _run(words: Iterable[str], fault: type[Exception], variables: dict[str, str] | None = None) -> str:
    """Run a program to its end; returns what it printed. Raises `fault`."""
    words = list(words)
    done = subprocess.run(
        words,
        env=variables or {**os.environ, "LC_ALL": "C"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=600,
    )
    if done.returncode:
        raise fault(f"{Path(words[0]).name} ended with {done.returncode}: {done.stdout.strip()}")
    return done.stdout

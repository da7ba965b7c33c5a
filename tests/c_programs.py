"""Programs in C: the C client and its test programs, built once for all tests with ASan and UBSan."""

import fcntl
import json
import os
import shutil
import signal
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from bus_cli.interface.c import header_of
from programs import Program, running_command

ROOT = Path(__file__).parents[1]
CLIENT = ROOT / "clients" / "c"
SOURCES = ROOT / "tests" / "c_client"
COMPILER = os.environ.get("BUSD_TEST_CC", "gcc")
CPP_COMPILER = COMPILER.replace("gcc", "g++")
EMULATOR = os.environ.get("BUSD_TEST_EMULATOR", "")
"""The program that runs the built programs, if the compiler is one for another processor (`make arm`)."""
SANITIZE = "" if EMULATOR else "-fsanitize=address,undefined -fno-sanitize-recover=undefined"
FLAGS = ["-Wall", "-Wextra", "-Werror", "-O0", "-g", *("-static" if EMULATOR else SANITIZE).split()]
INBOX_BYTES = 8 << 20
"""Most bytes of messages by socket that wait for a subscription, in the library of the tests."""
LIBRARY_FLAGS = f"-O0 -g -Werror -DINBOX_BYTES={INBOX_BYTES}u"
COUNTED = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
"""For a program that counts its allocations."""
MESSAGES = (
    "example_interfaces/srv/AddTwoInts",
    "geometry_msgs/msg/PoseArray",
    "rcl_interfaces/srv/ListParameters",
    "sensor_msgs/msg/Image",
    "std_msgs/msg/String",
)
"""Types of the test programs."""


def why_not() -> str:
    """Why programs in C can't be built here; "" if they can."""
    missing = [name for name in (COMPILER, "make", "ar") if shutil.which(name) is None]
    return f"the C client is not tested: no {', '.join(missing)}" if missing else ""


def build_once(factory: pytest.TempPathFactory) -> Path:
    """The folder with the built programs. All workers of pytest-xdist share it."""
    if reason := why_not():
        pytest.skip(reason)
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "c_client"
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "built").exists():
            _build(folder)
            (folder / "built").touch()
    return folder


def _build(folder: Path) -> None:
    for name in MESSAGES:
        path = folder / "types" / f"{name}.h"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(header_of(name))
        path.with_suffix(".hpp").write_text(header_of(name, "cpp"))
    made = (f"BUILD={folder}", f"CC={COMPILER}", f"SANITIZE={SANITIZE}", f"CFLAGS={LIBRARY_FLAGS}")
    run("make", "-s", "-C", CLIENT, "-j2", *made)
    for name in ("callbacks", "graph", "peer", "repack", "service"):
        compile_c(folder, SOURCES / f"{name}.c", folder / name, *(COUNTED if name == "callbacks" else ()))
    if not why_no_cpp():
        for name in ("graph", "peer", "service"):
            compile_cpp(folder, SOURCES / f"{name}.cpp", folder / f"{name}_cpp")


def why_no_cpp() -> str:
    """Why programs in C++ can't be built here; "" if they can."""
    return "" if shutil.which(CPP_COMPILER) else f"the C++ header is not tested: no {CPP_COMPILER}"


def compile_c(folder: Path, source: Path, program: Path, *options: str) -> None:
    """Build a program with the library of `folder`."""
    _compile(folder, source, program, COMPILER, "-std=c11", "-D_GNU_SOURCE", *options)


def compile_cpp(folder: Path, source: Path, program: Path, *options: str) -> None:
    """As `compile_c`, in C++17."""
    words = ("-std=c++17", "-Wpedantic", f"-I{ROOT / 'clients/cpp/include'}", *options)
    _compile(folder, source, program, CPP_COMPILER, *words)


def _compile(folder: Path, source: Path, program: Path, compiler: str, *options: str) -> None:
    """For an emulator, `program` is a script that runs the built one there."""
    includes = (f"-I{CLIENT / 'include'}", f"-I{folder / 'types'}")
    built = program.with_suffix(".built") if EMULATOR else program
    run(compiler, *FLAGS, *options, *includes, "-o", built, source, folder / "libbusd.a")
    if EMULATOR:
        program.write_text(f'#!/bin/sh\nexec {EMULATOR} {built} "$@"\n')
        program.chmod(0o755)


def run(*command: str | Path) -> str:
    """The output of a command, which must succeed."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    return done.stdout


class Peer:
    """tests/c_client/peer.c, running."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.line = program.line

    @property
    def numbers(self) -> list[int]:
        return [int(line.split()[0]) for line in self.program.lines if line[:1].isdigit()]

    def events(self) -> list[str]:
        return [line for line in self.program.lines if line.startswith("event ")]

    async def finish(self) -> dict[str, int]:
        """End it; returns its statistics. It must have no memory error and no leak."""
        self.program.process.send_signal(signal.SIGTERM)
        assert await self.program.end() == 0, self.program.lines
        return self.statistics()[-1]

    def statistics(self) -> list[dict[str, int]]:
        found: list[dict[str, int]] = []
        for line in self.program.lines:
            kind, _, text = line.partition(" ")
            if kind in ("publisher", "subscription") and text.startswith("{"):
                found.append(json.loads(text))
        return found


@asynccontextmanager
async def peer(folder: Path, temporary: Path, *words: str, **variables: Any) -> AsyncIterator[Peer]:
    """A peer that is ready; killed if it still runs after the test."""
    program_name = "peer_cpp" if words == ("cpp",) else "peer"
    async with running_command(temporary, folder / program_name, *words, **variables) as program:
        await program.line("^ready$")
        yield Peer(program)

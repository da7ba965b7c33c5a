"""Builds the native core, and adds the C client.

BUS_NATIVE=auto (the default: without the core where it can't be built) | yes | no.

A wheel is named for what is in it: without the core `py3-none-any`.
"""

import os
import shutil
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

HERE = Path(__file__).parent
CORES = {
    "bus.shm._core": Path("clients", "bus", "shm"),
    "bus_tf2.core._core": Path("clients", "bus_tf2", "core"),
    "bus_bag.core._core": Path("clients", "bus_bag", "core"),
}
"""The native cores, and where their sources are: all of a folder."""
C_CLIENT = (
    *(
        "c/Makefile",
        "c/CMakeLists.txt",
        "c/*.in",
        "c/*.cmake",
        "c/include/busd/*.h",
        "c/src/*.[ch]",
        "c/examples/*.c",
    ),
    *("cpp/include/busd/*.hpp", "bus/shm/[!p]*.h", "bus/base/version.py"),
)
"""Files of `clients/` that a program in C or C++ needs. A wheel has them below `bus_c`."""


def c_client() -> Iterator[str]:
    """Paths of these files, relative to `clients/`."""
    clients = HERE / "clients"
    for pattern in C_CLIENT:
        yield from sorted(str(path.relative_to(clients)) for path in clients.glob(pattern))


class BuildPy(build_py):
    """Adds the C client. An editable installation finds it in the tree."""

    def run(self) -> None:
        super().run()
        for name in () if self.editable_mode else c_client():
            target = Path(self.build_lib, "bus_c", name)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(HERE / "clients" / name, target)


class BuildExt(build_ext):
    """Leaves no core of an earlier build where this one can't be built."""

    def run(self) -> None:
        if self.inplace:
            for folder in CORES.values():
                for core in (HERE / folder).glob("_core*.so"):
                    core.unlink()
        super().run()

    def build_extension(self, ext: Extension) -> None:
        Path(self.get_ext_fullpath(ext.name)).unlink(missing_ok=True)
        super().build_extension(ext)


class BdistWheel(bdist_wheel):
    """Names the wheel once it is known whether it has the core."""

    def run(self) -> None:
        self.run_command("build_ext")
        build = self.get_finalized_command("build_ext")
        if not all(Path(output).exists() for output in build.get_outputs()):
            self.distribution.ext_modules = []
            self.root_is_pure, self.py_limited_api = True, ""
        super().run()


def why_no_core() -> str:
    """What keeps the core from being built for this Python, in a few words; "" where it can be tried."""
    if sys.platform != "linux":
        return f"it needs Linux, this is {sys.platform}"
    if sys.implementation.name != "cpython":
        return f"it needs CPython, this is {sys.implementation.name}"
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "it needs a Python with the GIL (the limited API), this one is free-threaded"
    return ""


def extensions() -> list[Extension]:
    wish = os.environ.get("BUS_NATIVE", "auto")
    if wish not in ("auto", "yes", "no"):
        raise SystemExit(f"BUS_NATIVE is {wish!r}; it must be auto, yes or no")
    reason = why_no_core()
    if wish == "yes" and reason:
        raise SystemExit(f"BUS_NATIVE=yes: the native core can't be built: {reason}")
    if wish == "no" or reason:
        if reason:
            print(f"busd is built without its native core: {reason}", file=sys.stderr)
        return []
    return [
        Extension(
            name=name,
            sources=sorted(str(folder / path.name) for path in (HERE / folder).glob("*.c")),
            depends=sorted(str(folder / path.name) for path in (HERE / folder).glob("*.h")),
            define_macros=[("Py_LIMITED_API", "0x030B0000"), ("_GNU_SOURCE", "1")],
            # What the limited API does not declare must not be called: it may be gone in the next Python.
            extra_compile_args=[
                *("-std=c11", "-O2", "-Wall", "-Wextra", "-fvisibility=hidden"),
                "-Werror=implicit-function-declaration",
            ],
            py_limited_api=True,
            optional=wish != "yes",
        )
        for name, folder in CORES.items()
    ]


if __name__ == "__main__":
    modules = extensions()
    setup(
        ext_modules=modules,
        cmdclass={"build_ext": BuildExt, "build_py": BuildPy, "bdist_wheel": BdistWheel},
        options={"bdist_wheel": {"py_limited_api": "cp311"}} if modules else {},
    )

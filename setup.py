"""Builds the native core. BUS_NATIVE=auto (the default: without it where it can't be built) | yes | no."""

import os
import sys
from pathlib import Path

from setuptools import Extension, setup

HERE = Path(__file__).parent
FOLDER = Path("clients", "bus", "shm")


def extensions() -> list[Extension]:
    wish = os.environ.get("BUS_NATIVE", "auto")
    if wish not in ("auto", "yes", "no"):
        raise SystemExit(f"BUS_NATIVE is {wish!r}; it must be auto, yes or no")
    if wish == "yes" and sys.platform != "linux":
        raise SystemExit("BUS_NATIVE=yes: the native core needs Linux")
    if wish == "no" or sys.platform != "linux" or sys.implementation.name != "cpython":
        return []
    core = Extension(
        "bus.shm._core",
        sources=sorted(str(FOLDER / path.name) for path in (HERE / FOLDER).glob("*.c")),
        depends=sorted(str(FOLDER / path.name) for path in (HERE / FOLDER).glob("*.h")),
        define_macros=[("Py_LIMITED_API", "0x030B0000"), ("_GNU_SOURCE", "1")],
        extra_compile_args=["-std=c11", "-O2", "-Wall", "-Wextra", "-fvisibility=hidden"],
        py_limited_api=True,
        optional=wish != "yes",
    )
    return [core]


modules = extensions()
setup(ext_modules=modules, options={"bdist_wheel": {"py_limited_api": "cp311"}} if modules else {})

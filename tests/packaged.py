"""`bus` as a process for tests of packages, which needs no installed busd."""

import os
import subprocess
import sys
from pathlib import Path

import bus
import busd
from cli import Result, Running

WAIT_S = 120.0 * float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))
VERSION = f"python{sys.version_info.major}.{sys.version_info.minor}"


__all__ = ["VERSION", "Result", "run_bus", "sources"]


def run_bus(*words: str, python: str = sys.executable, **variables: str) -> Result:
    if python == sys.executable and not variables:
        with Running(("-m", "bus_cli", *words)) as running:
            return running.end()
    done = subprocess.run(
        [python, "-m", "bus_cli", *words],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        env={**os.environ, **variables},
        check=False,
    )
    return Result(done.stdout, done.stderr, done.returncode)


def sources() -> str:
    return os.pathsep.join(str(Path(str(package.__file__)).parents[1]) for package in (bus, busd))

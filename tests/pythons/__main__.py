"""`python -m pythons`: the unit tests and those of shared memory, with every Python that is found.

Each has the source distribution for itself, busd installed from that, and the development tools.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pythons import Python, find, lacking_package, make_venv, missing
from wheels import Wrong, building

TESTS = ("tests/unit", "tests/system/test_rings.py", "tests/system/test_routes.py")
_LOG = Path("pytest.log")
_OTHERS = "others"


def main() -> int:
    parser = argparse.ArgumentParser(prog="pythons", description=__doc__)
    parser.add_argument(
        "versions", nargs="*", help="such as 3.12 or 3.13t, or others: all but this one (default: all found)"
    )
    versions = parser.parse_args().versions
    found = find()
    if versions == [_OTHERS]:
        versions = [python.name for python in found if python.version != sys.version_info[:3]]
        if not versions:
            print("no other Python is found on PATH, of pyenv or of uv")
            return 0
    for name in versions or missing(found):
        if name not in {python.name for python in found}:
            print(f"Python {name}: not found on PATH, of pyenv or of uv", flush=True)
    chosen = [python for python in found if not versions or python.name in versions]
    print(f"to be tested: {', '.join(map(str, chosen)) or 'none'}; minutes each", flush=True)
    with tempfile.TemporaryDirectory(prefix="pythons-") as folder:
        Path(folder).chmod(0o755)  # some tests run programs as another user
        try:
            sdist, _ = building.build_sdist(Path(folder))
            passed = [_try(python, sdist, Path(folder, python.name)) for python in chosen]
        except Wrong as error:
            print(f"pythons: {error}", file=sys.stderr)
            return 1
    return int(not all(passed))


def _try(python: Python, sdist: Path, folder: Path) -> bool:
    begin = time.monotonic()
    sources = building.unpack(sdist, folder)
    venv = make_venv(python, sources / ".venv")
    reason = python.why_no_core()
    if reason:
        if not _install(venv, sources, ".", "yes"):
            print(f"Python {python}: BUS_NATIVE=yes did not fail, though {reason}", flush=True)
            return False
        print(f"Python {python}: without the native core: {reason}", flush=True)
    if fault := _install(venv, sources, ".[dev]", "auto" if reason else "yes"):
        package = lacking_package(fault, python.version)
        reason = f"{package} can't be had for it" if package else f"busd can't be installed:\n{fault}"
        print(f"Python {python}: left out: {reason}", flush=True)
        return bool(package)
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("BUS", "PYTHON"))}
    with (sources / _LOG).open("w") as log:
        words = [
            str(venv),
            "-m",
            "pytest",
            "-q",
            "-rfE",
            "-n",
            "logical",
            "-p",
            "no:cacheprovider",
            *TESTS,
        ]
        status = subprocess.run(words, cwd=sources, env=environment, stdout=log, stderr=log, check=False)
    lines = (sources / _LOG).read_text().splitlines()
    print(f"Python {python}: {lines[-1]}, {time.monotonic() - begin:.0f} s in all", flush=True)
    if status.returncode:
        print("\n".join(lines[-60:]), flush=True)
    return not status.returncode


def _install(venv: Path, sources: Path, what: str, native: str) -> str:
    """Install into an environment; returns what pip says where it fails, else ""."""
    pip = [sys.executable, "-m", "pip", "--python", str(venv), "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, "install", "-qq", "--editable", what],
        cwd=sources,
        env={**os.environ, "BUS_NATIVE": native},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stderr if done.returncode else ""


if __name__ == "__main__":
    sys.exit(main())

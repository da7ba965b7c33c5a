"""The first minutes with a wheel: an empty environment, and the README's programs in another folder."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO

from pages import blocks
from pythons import Python, lacking_package, make_venv
from wheels import Missing, Wrong
from wheels.sources import ROOT

__all__ = ["PATIENCE_S", "Environment", "try_wheel"]

PATIENCE_S = 60.0
"""How long a program may take for what it is to do, in seconds."""

_SLOW = "messages go by socket, not by shared memory: "
_LESSON = ROOT / "tests" / "lesson" / "publisher_member_function.py"


class Environment:
    """An environment with busd. Its programs run in a folder that has nothing of the tree."""

    def __init__(self, python: Python, folder: Path) -> None:
        folder.mkdir(parents=True)
        self._version = python.version
        self._python = make_venv(python, folder / "venv")
        self.bin = self._python.parent
        self.folder = folder / "home"
        self.folder.mkdir()
        mine = ("BUS", "PYTHON", "VIRTUAL_ENV")
        self.variables = {key: value for key, value in os.environ.items() if not key.startswith(mine)}
        self.variables["BUSD_SOCKET"] = str(folder / "s")

    def install(self, what: str) -> None:
        """Install a wheel, or one with an extra, and what that needs.

        Raises Missing if the index has no package that a Python other than this one needs, else Wrong.
        """
        pip = [sys.executable, "-m", "pip", "--python", str(self._python), "--disable-pip-version-check"]
        done = subprocess.run([*pip, "install", "-qq", what], capture_output=True, text=True, check=False)
        if done.returncode and (package := lacking_package(done.stderr, self._version)):
            raise Missing(f"{what}: {package} can't be had for Python {'.'.join(map(str, self._version))}")
        if done.returncode:
            raise Wrong(f"pip can't install {what}:\n{done.stderr}")

    def run(self, program: str, *words: str) -> str:
        """Run it to its end; returns what it printed."""
        done = subprocess.run(
            [self.bin / program, *words],
            cwd=self.folder,
            env=self.variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        if done.returncode:
            raise Wrong(f"{program} {' '.join(words)} ended with {done.returncode}:\n{done.stdout}")
        return done.stdout

    def start(self, output: IO[str], program: str, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.bin / program, *words],
            cwd=self.folder,
            env=self.variables,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
        )


def try_wheel(wheel: Path, python: Python, folder: Path, *, with_core: bool) -> float:
    """Install it into an empty environment and use it; returns the seconds from there to "I heard"."""
    begin = time.monotonic()
    environment = Environment(python, folder)
    environment.install(str(wheel))
    names = _write_readme_programs(environment.folder)
    shutil.copy(_LESSON, environment.folder)
    heard_s = _hear(environment, names, with_core=with_core) - begin
    version = wheel.name.split("-")[1]
    for program in ("bus", "busd"):
        if (said := environment.run(program, "--version")) != f"{program} {version}\n":
            raise Wrong(f"{program} --version says {said!r}")
    client = Path(environment.run("bus", "interface", "c", "--path").strip())
    if not (client / "Makefile").is_file():
        raise Wrong(f"the client for C in {client} has no Makefile")
    said = environment.run("python", "-c", "from bus import shm; print(shm.why_not())")
    if (said == "\n") != with_core:
        raise Wrong(f"shared memory, {with_core = }: {said!r}")
    environment.run("bus", "daemon", "stop")
    return heard_s


def _write_readme_programs(folder: Path) -> list[str]:
    """Each Python block of the README, under the name that it has in examples/."""
    known = {path.read_text(): path.name for path in (ROOT / "examples").glob("*.py")}
    names: list[str] = []
    for block in blocks("python", (ROOT / "README.md").read_text()):
        name = known.get(block, f"block_{len(names)}.py")
        (folder / name).write_text(block)
        names.append(name)
    return names


def _hear(environment: Environment, names: list[str], *, with_core: bool) -> float:
    """Run the README's programs together, then the lesson's; returns when the first "I heard" was there."""
    log = environment.folder / "log"
    with log.open("w") as output:
        running = [environment.start(output, "python", name) for name in names]
        try:
            _await(log, 'I heard: "Hello World: ')
            heard = time.monotonic()
            running.append(environment.start(output, "bus", "run", _LESSON.name))
            _await(log, 'Publishing: "Hello World: 0"', times=2)
        finally:
            for program in running:
                program.send_signal(signal.SIGINT)
            codes = [program.wait(PATIENCE_S) for program in running]
    said = log.read_text()
    if set(codes) - {0, -signal.SIGINT} or "Traceback" in said:
        raise Wrong(f"the README's programs ended with {codes}:\n{said}")
    if said.count(_SLOW) != (0 if with_core else len(running)):
        raise Wrong(f"{said.count(_SLOW)} of {len(running)} programs say that they have no core:\n{said}")
    return heard


def _await(log: Path, text: str, times: int = 1) -> None:
    end = time.monotonic() + PATIENCE_S
    while log.read_text().count(text) < times:
        if time.monotonic() > end:
            raise Wrong(f"{text!r} did not come:\n{log.read_text()}")
        time.sleep(0.02)

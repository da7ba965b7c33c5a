"""The first minutes with a wheel: an empty environment, the README's programs in another folder, extras."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO

from pages import blocks
from pythons import Python, make_venv
from wheels import Wrong
from wheels.building import ROOT

__all__ = ["EXTRAS", "FOR_DEVELOPERS", "try_extra", "try_wheel"]

FOR_DEVELOPERS = {"bench", "dev", "fuzz", "release", "soak"}
EXTRAS = {"cli": ("completion", "bash"), "metrics": ("metrics", "--once")}
"""Of the other extras, a command of `bus` that can't do without."""

_PATIENCE_S = 60.0
_SLOW = "messages go by socket, not by shared memory: "
_LESSON = ROOT / "tests" / "lesson" / "publisher_member_function.py"


class _Terminal:
    """Commands as a user of the environment types them, in a folder that has nothing of the tree."""

    def __init__(self, python: Path, folder: Path) -> None:
        self.bin = python.parent
        self.folder = folder
        mine = ("BUS", "PYTHON", "VIRTUAL_ENV")
        self.environment = {key: value for key, value in os.environ.items() if not key.startswith(mine)}
        self.environment["BUSD_SOCKET"] = str(folder / "s")

    def run(self, program: str, *words: str) -> str:
        """Run it to its end; returns what it printed."""
        done = subprocess.run(
            [self.bin / program, *words],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=_PATIENCE_S,
            check=False,
        )
        if done.returncode:
            raise Wrong(f"{program} {' '.join(words)} ended with {done.returncode}:\n{done.stdout}")
        return done.stdout

    def start(self, output: IO[str], program: str, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.bin / program, *words],
            cwd=self.folder,
            env=self.environment,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
        )


def try_wheel(wheel: Path, python: Python, folder: Path, *, with_core: bool) -> float:
    """Install it into an empty environment and use it; returns the seconds from there to "I heard"."""
    folder.mkdir(parents=True)
    begin = time.monotonic()
    terminal = _install(str(wheel), python, folder)
    (folder / "home").mkdir()
    terminal.folder = folder / "home"
    names = _write_readme_programs(terminal.folder)
    shutil.copy(_LESSON, terminal.folder)
    heard_s = _hear(terminal, names, with_core=with_core) - begin
    version = wheel.name.split("-")[1]
    for program in ("bus", "busd"):
        if (said := terminal.run(program, "--version")) != f"{program} {version}\n":
            raise Wrong(f"{program} --version says {said!r}")
    said = terminal.run("python", "-c", "from bus import shm; print(shm.why_not())")
    if (said == "\n") != with_core:
        raise Wrong(f"shared memory, {with_core = }: {said!r}")
    terminal.run("bus", "daemon", "stop")
    return heard_s


def try_extra(wheel: Path, extra: str, python: Python, folder: Path) -> None:
    """Install the wheel with it into an empty environment, and do what needs it."""
    folder.mkdir(parents=True)
    terminal = _install(f"{wheel}[{extra}]", python, folder)
    terminal.run("bus", "daemon", "start")
    terminal.run("bus", *EXTRAS[extra])
    terminal.run("bus", "daemon", "stop")


def _install(what: str, python: Python, folder: Path) -> _Terminal:
    venv = make_venv(python, folder / "venv")
    pip = [sys.executable, "-m", "pip", "--python", str(venv), "--disable-pip-version-check"]
    done = subprocess.run([*pip, "install", "-qq", what], capture_output=True, text=True, check=False)
    if done.returncode:
        raise Wrong(f"pip can't install {what} for Python {python}:\n{done.stderr}")
    return _Terminal(venv, folder)


def _write_readme_programs(folder: Path) -> list[str]:
    """Each Python block of the README, under the name that it has in examples/."""
    known = {path.read_text(): path.name for path in (ROOT / "examples").glob("*.py")}
    names: list[str] = []
    for block in blocks("python", (ROOT / "README.md").read_text()):
        name = known.get(block, f"block_{len(names)}.py")
        (folder / name).write_text(block)
        names.append(name)
    return names


def _hear(terminal: _Terminal, names: list[str], *, with_core: bool) -> float:
    """Run the README's programs together, then the lesson's; returns when the first "I heard" was there."""
    log = terminal.folder / "log"
    with log.open("w") as output:
        running = [terminal.start(output, "python", name) for name in names]
        try:
            _await(log, 'I heard: "Hello World: ')
            heard = time.monotonic()
            running.append(terminal.start(output, "bus", "run", _LESSON.name))
            _await(log, 'Publishing: "Hello World: 0"', times=2)
        finally:
            for program in running:
                program.send_signal(signal.SIGINT)
            codes = [program.wait(_PATIENCE_S) for program in running]
    said = log.read_text()
    if set(codes) - {0, -signal.SIGINT} or "Traceback" in said:
        raise Wrong(f"the README's programs ended with {codes}:\n{said}")
    if said.count(_SLOW) != (0 if with_core else len(running)):
        raise Wrong(f"{said.count(_SLOW)} of {len(running)} programs say that they have no core:\n{said}")
    return heard


def _await(log: Path, text: str, times: int = 1) -> None:
    end = time.monotonic() + _PATIENCE_S
    while log.read_text().count(text) < times:
        if time.monotonic() > end:
            raise Wrong(f"{text!r} did not come:\n{log.read_text()}")
        time.sleep(0.02)

"""What a figure depends on: processor, kernel, versions, commit. No host name, no user, no path."""

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

ROOT = Path(__file__).resolve().parent.parent

_PACKAGES = ("busd", "msgspec", "uvloop", "pyzmq", "iceoryx2")
_GIT_S = 5.0


class Machine(msgspec.Struct, frozen=True):
    """Where and with what a run was made. `load` is the machine's load average when it began."""

    processor: str
    cpus: int
    is_virtual: bool
    memory_gib: float
    kernel: str
    python: str
    packages: dict[str, str]
    commit: str
    load: float

    def describe(self) -> str:
        """Two lines for people."""
        kind = "virtual machine" if self.is_virtual else "machine"
        packages = ", ".join(f"{name} {number}" for name, number in self.packages.items())
        return (
            f"{self.processor}, {self.cpus} CPUs, {self.memory_gib:g} GiB, {kind}, {self.kernel}, "
            f"load {self.load:.2f} at the start\n{self.python}, {packages}, commit {self.commit or 'unknown'}"
        )


def look_at_machine() -> Machine:
    """The facts of this machine, now."""
    information = _read("/proc/cpuinfo")
    pages = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return Machine(
        processor=_field(information, "model name") or platform.machine(),
        cpus=len(os.sched_getaffinity(0)),
        is_virtual=" hypervisor " in f" {_field(information, 'flags')} ",
        memory_gib=round(pages / 2**30, 1),
        kernel=f"{platform.system()} {platform.release()}",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        packages={name: _version(name) for name in _PACKAGES},
        commit=_commit(),
        load=os.getloadavg()[0],
    )


def _read(path: str) -> str:
    try:
        return Path(path).read_text(errors="replace")
    except OSError:
        return ""


def _field(text: str, name: str) -> str:
    for line in text.splitlines():
        key, _, value = line.partition(":")
        if key.strip() == name:
            return value.strip()
    return ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from source" if package == "busd" else "missing"


def _commit() -> str:
    """The short commit, with a + where files differ from it; empty where there is no git to ask."""
    commit = _git("rev-parse", "--short=12", "HEAD")
    return commit + ("+" if commit and _git("status", "--porcelain", "--untracked-files=no") else "")


def _git(*arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, timeout=_GIT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""

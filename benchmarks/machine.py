"""The conditions of a figure: processor, kernel, versions, commit. No host name, no user, no path."""

import os
import platform
import re
import shutil
import subprocess
import textwrap
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path

import msgspec

ROOT = Path(__file__).resolve().parent.parent

ROS_VENV = ROOT / ".venv-jazzy"
"""The folder in which `make peers` installs ROS 2's rclpy. Its modules have the same names as busd's
facade."""
_PACKAGES = (
    "busd",
    "msgspec",
    "uvloop",
    "pyzmq",
    "iceoryx2",
    "eclipse-zenoh",
    "eclipse-ecal",
    "cyclonedds",
    "nats-py",
    "redis",
    "hiredis",
)
_SERVERS = ("nats-server", "redis-server")
PRODUCT = ("busd", "clients", "setup.py")
"""The files and folders that a benchmark measures."""
_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/usr/local/sbin"])
_COMMAND_S = 5.0
_GOVERNOR = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
_CLOCK = "/sys/devices/system/clocksource/clocksource0/current_clocksource"


class Machine(msgspec.Struct, frozen=True):
    """The machine and the versions of a run. `load` is the machine's load average at its start.

    `servers` are rivals' servers that are not Python packages. `governor` (of the CPU's frequency) and
    `clock` (the kernel's source of time) are empty if the kernel does not report them.
    """

    processor: str
    cpus: int
    is_virtual: bool
    memory_gib: float
    kernel: str
    python: str
    packages: dict[str, str]
    commit: str
    load: float
    servers: dict[str, str] = {}
    governor: str = ""
    clock: str = ""

    def describe(self) -> str:
        """Lines for people: the machine, and the software on it."""
        programs = (self.packages | self.servers).items()
        return (
            f"{self.hardware()}, load {self.load:.2f} at the start\n"
            f"{self.python}, commit {self.commit or 'unknown'}\n"
            + textwrap.fill(", ".join(f"{name} {number}" for name, number in programs), 120)
        )

    def hardware(self) -> str:
        """Processor, memory, kernel, and their clocks."""
        kind = "virtual machine" if self.is_virtual else "machine"
        clocks = [f"governor {self.governor}"] if self.governor else []
        clocks += [f"clock {self.clock}"] if self.clock else []
        facts = [self.processor, f"{self.cpus} CPUs", f"{self.memory_gib:g} GiB", kind, self.kernel, *clocks]
        return ", ".join(facts)


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
        packages={name: _version(name) for name in _PACKAGES} | {"rclpy": _ros_version()},
        commit=_commit(),
        load=os.getloadavg()[0],
        servers={name: _server_version(name) for name in _SERVERS},
        governor=_read(_GOVERNOR).strip(),
        clock=_read(_CLOCK).strip(),
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


def _ros_version() -> str:
    site = [str(path) for path in ROS_VENV.glob("lib/python*/site-packages")]
    return next((one.version for one in distributions(name="ros-rclpy", path=site)), "missing")


def path_of(program: str) -> str:
    """The path of a server, also in folders that only root searches; empty if it is missing."""
    return shutil.which(program, path=_PATH) or ""


def _server_version(program: str) -> str:
    path = path_of(program)
    found = re.search(r"\d+(?:\.\d+)+", _output(path, "--version")) if path else None
    return found.group() if found else "missing"


def _commit() -> str:
    """The short commit, with a + if files differ from it; empty without git."""
    commit = _git("rev-parse", "--short=12", "HEAD")
    return commit + ("+" if commit and _git("status", "--porcelain", "--untracked-files=no") else "")


def changes_since(commit: str) -> list[str] | None:
    """The files of `PRODUCT` that differ from `commit`.

    None if git can't tell: it does not know the commit, or files differed from it then (a + at its end).
    """
    if not commit or commit.endswith("+"):
        return None
    changed = _run("git", "-C", str(ROOT), "diff", "--name-only", commit, "--", *PRODUCT)
    added = _run(
        "git", "-C", str(ROOT), "ls-files", "--others", "--exclude-standard", "--full-name", "--", *PRODUCT
    )
    return None if changed is None or added is None else [*changed.splitlines(), *added.splitlines()]


def _git(*arguments: str) -> str:
    return _output("git", "-C", str(ROOT), *arguments)


def _output(*command: str) -> str:
    """The output of a command; empty if the command is missing or fails."""
    return _run(*command) or ""


def _run(*command: str) -> str | None:
    """The output of a command; None if the command is missing or fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None

"""Memory cgroups of the kernel, as containers have them: v2, or v1 if the kernel uses it. For root only.

if not (reason := why_not()):
    place = make("name", 64 << 20)     limited to this many bytes
    enter(place)                       memory that this process takes from now on counts there
    kills(place)                       how many processes the kernel has killed for lack of memory
    remove(place)                      once no process is in it
"""

import contextlib
import os
from functools import cache
from pathlib import Path

_ROOT = Path("/sys/fs/cgroup")


@cache
def why_not() -> str:
    """The reason why cgroups are impossible here; "" if they are possible."""
    if os.geteuid() != 0:
        return "only root can make a memory cgroup"
    if _is_v1():
        return ""
    try:
        if "memory" not in (_ROOT / "cgroup.subtree_control").read_text().split():
            (_ROOT / "cgroup.subtree_control").write_text("+memory")
    except OSError as error:
        return f"no memory cgroup can be made: {error.strerror}"
    return ""


def make(name: str, limit_bytes: int) -> Path:
    """Make a cgroup. Raises OSError."""
    place = _parent() / f"busd-{os.getpid()}-{name}"
    place.mkdir()
    (place / ("memory.limit_in_bytes" if _is_v1() else "memory.max")).write_text(str(limit_bytes))
    if not _is_v1():
        with contextlib.suppress(OSError):  # there is no swap
            (place / "memory.swap.max").write_text("0")
    return place


def enter(place: Path) -> None:
    (place / "cgroup.procs").write_text(str(os.getpid()))


def kills(place: Path) -> int:
    name = "memory.oom_control" if _is_v1() else "memory.events"
    lines = (place / name).read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("oom_kill "))


def remove(place: Path) -> None:
    place.rmdir()


def _is_v1() -> bool:
    return (_ROOT / "memory" / "memory.limit_in_bytes").exists()


def _parent() -> Path:
    if not _is_v1():
        return _ROOT
    lines = Path("/proc/self/cgroup").read_text().splitlines()
    own = next((path for _, kinds, path in (line.split(":", 2) for line in lines) if kinds == "memory"), "/")
    place = _ROOT / "memory" / own.lstrip("/")
    return place if place.exists() else _ROOT / "memory"

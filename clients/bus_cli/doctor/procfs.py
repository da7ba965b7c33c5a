"""The kernel's data about processes and sockets (proc(5)), which may be gone or hidden at any time.

Must not judge the data.
"""

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = [
    "age_s",
    "command_line",
    "executable",
    "folder",
    "listening_paths",
    "listens_on",
    "number_in",
    "open_files",
    "pids_of",
    "state",
]

_PROC = Path("/proc")
_LISTENS = 0x10000
"""The flag __SO_ACCEPTCON in /proc/net/unix: the socket listens."""


def state(pid: int) -> str:
    """State as one letter: R, S, T (stopped), Z (ended, but not reaped); "" if there is no such process."""
    fields = _stat(pid)
    return fields[0] if fields else ""


def age_s(pid: int) -> float | None:
    """Seconds since the start of a process."""
    fields = _stat(pid)
    if not fields:
        return None
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def command_line(pid: int) -> list[str]:
    """The command line of a process; empty if unreadable, or if the process just starts or has ended."""
    with suppress(OSError):
        line = (_PROC / str(pid) / "cmdline").read_text(errors="replace")
        return line.removesuffix("\0").split("\0") if line else []
    return []


def folder(pid: int) -> Path | None:
    """The current folder of a process, to which its relative paths refer."""
    with suppress(OSError):
        return (_PROC / str(pid) / "cwd").readlink()
    return None


def executable(pid: int) -> str | None:
    """The path of the program's file; it ends with " (deleted)" if the file has been replaced."""
    with suppress(OSError):
        return str((_PROC / str(pid) / "exe").readlink())
    return None


def open_files(pid: int) -> tuple[int, int] | None:
    """The number of open files of a process, and its limit."""
    with suppress(OSError, ValueError, IndexError):
        limits = (_PROC / str(pid) / "limits").read_text().splitlines()
        most = next(line for line in limits if line.startswith("Max open files")).split()[3]
        return len([*(_PROC / str(pid) / "fd").iterdir()]), int(most)
    return None


def pids_of(uid: int) -> Iterator[int]:
    """Process ids of all processes of a user."""
    for entry in _PROC.iterdir():
        with suppress(OSError):
            if entry.name.isdigit() and entry.stat().st_uid == uid:
                yield int(entry.name)


def listening_paths() -> dict[int, str]:
    """Paths of the UNIX sockets that listen in this network namespace, by their numbers."""
    found = {}
    with suppress(OSError):
        for line in (_PROC / "net" / "unix").read_text(errors="replace").splitlines()[1:]:
            fields = line.split(maxsplit=7)
            if len(fields) == 8 and fields[7][0] == "/" and int(fields[3], 16) & _LISTENS:
                found[int(fields[6])] = fields[7]
    return found


def listens_on(pid: int, sockets: dict[int, str]) -> list[str]:
    """Paths of the `sockets` (from `listening_paths`) that a process has open."""
    found = []
    with suppress(OSError):
        for entry in (_PROC / str(pid) / "fd").iterdir():
            with suppress(OSError):
                what = str(entry.readlink())
                if what.startswith("socket:[") and (path := sockets.get(int(what[8:-1]))):
                    found.append(path)
    return sorted(found)


def number_in(path: str, name: str = "") -> int | None:
    """The first number in a file, or in its line that begins with `name`."""
    with suppress(OSError, ValueError, StopIteration, IndexError):
        lines = Path(path).read_text().splitlines()
        line = next(line for line in lines if line.startswith(name))
        return int(line.removeprefix(name).split()[0])
    return None


def _stat(pid: int) -> list[str]:
    """The fields after the name; the first one is the state."""
    with suppress(OSError):
        return (_PROC / str(pid) / "stat").read_text(errors="replace").rpartition(")")[2].split()
    return []

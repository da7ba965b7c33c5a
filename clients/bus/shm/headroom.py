"""Free memory of a process's memory cgroups, as in a container, and of the machine.

At such a limit the kernel kills a process without an error. So a process checks the free memory before it
makes a segment. A reserve stays free for everything else that programs do meanwhile.
"""

import errno
import math
import os
import re
from collections.abc import Iterator
from functools import lru_cache
from time import monotonic_ns
from typing import NamedTuple

__all__ = ["Room", "claim", "rooms", "spare"]

PROC = "/proc"

_RESERVE_PART = 16
_RESERVE_LEAST = 8 << 20
_RESERVE_MOST = 64 << 20

_SMALL_BYTES = 1 << 20
"""Smaller segments need no separate check if a recent check has found enough memory."""
_GRANT_PART = 16
_GRANT_NS = 1_000_000_000

_UNLIMITED = 1 << 60
_MOST_BYTES = 1 << 16


class Room(NamedTuple):
    """Memory left below one limit: `where` may use `limit` bytes; `left` of them are free, or cache files."""

    where: str
    limit: int
    left: int

    @property
    def reserve(self) -> int:
        """Bytes that segments must leave free."""
        return min(max(self.limit // _RESERVE_PART, _RESERVE_LEAST), _RESERVE_MOST)


class _Kind(NamedTuple):
    """The names of the files of one kind of cgroup."""

    limits: tuple[str, ...]
    usage: str
    caches: tuple[tuple[str, int], ...]  # in memory.stat; the kernel can easily free one part in this number


_V1 = _Kind(
    ("memory.limit_in_bytes",),
    "memory.usage_in_bytes",
    (("total_inactive_file", 1), ("total_active_file", 2)),
)
_V2 = _Kind(("memory.max", "memory.high"), "memory.current", (("inactive_file", 1), ("active_file", 2)))


class _Grant:
    """Memory that all segments of this process together may take without another check."""

    left = 0
    until_ns = 0


def claim(size: int, *, of: int = 0) -> None:
    """Raise OSError (ENOMEM) if another `size` bytes would use the reserve. It names the limit and the rest.

    `of`: the size of the whole segment, if `size` is only its rest. The reserve is at least half of that
    size, because large rings hold long messages, and programs that work on them need memory, too.
    """
    now_ns = monotonic_ns()
    least = max(size, of) // 2
    if size < _SMALL_BYTES and size <= _Grant.left and now_ns < _Grant.until_ns:
        _Grant.left -= size
        return
    free = _UNLIMITED
    for room in rooms(need=size + least):
        kept = max(room.reserve, least)
        free = min(free, room.left - kept)
        if free < size:
            left, limit, more, reserve = (_mib(number) for number in (room.left, room.limit, size, kept))
            text = (
                f"{room.where} has {left} of {limit} MiB left; this takes {more} and a reserve of {reserve}"
            )
            raise OSError(errno.ENOMEM, text)
    _Grant.left, _Grant.until_ns = (free - size) // _GRANT_PART, now_ns + _GRANT_NS


def _mib(size: int) -> int:
    return -(-size >> 20)


def spare() -> int:
    """Free bytes above the reserves."""
    return min((room.left - room.reserve for room in rooms()), default=_UNLIMITED)


def rooms(process: int | str = "self", *, need: float = math.inf) -> Iterator[Room]:
    """The memory left in each limited memory cgroup of `process`, and in the machine, as far as it is known.

    Caches are read only if fewer than `need` bytes are free without them.
    """
    try:
        cgroups = _read(f"{PROC}/{process}/cgroup")
        places = _places(cgroups, PROC)
    except OSError:  # another system, or no /proc
        places = ()
    for folder, kind in places:
        room = _of_cgroup(folder, kind, need)
        if room is not None:
            yield room
    room = _of_machine()
    if room is not None:
        yield room


def _of_cgroup(folder: str, kind: _Kind, need: float) -> Room | None:
    limit = min((_number(f"{folder}/{name}") for name in kind.limits), default=_UNLIMITED)
    if limit >= _UNLIMITED:
        return None
    used = _number(f"{folder}/{kind.usage}")
    if used >= _UNLIMITED:
        return None
    room = Room(f"memory cgroup {folder}", limit, max(limit - used, 0))
    if room.left - room.reserve < need:
        fields = _fields(f"{folder}/memory.stat")
        caches = sum(fields.get(name, 0) // part for name, part in kind.caches)
        room = room._replace(left=max(limit - used + caches, 0))
    return room


def _of_machine() -> Room | None:
    fields = _fields(f"{PROC}/meminfo")
    total, available = fields.get("MemTotal:"), fields.get("MemAvailable:")
    if total is None or available is None:
        return None
    return Room("the machine", total << 10, available << 10)


def _number(path: str) -> int:
    """The number in a file; _UNLIMITED if it has no number, or does not exist."""
    try:
        return int(_read(path))
    except (OSError, ValueError):
        return _UNLIMITED


def _fields(path: str) -> dict[str, int]:
    """The first number of each line, by the word before it."""
    try:
        lines = _read(path).splitlines()
    except OSError:
        return {}
    return {
        words[0]: int(words[1]) for line in lines if len(words := line.split()) > 1 and words[1].isdigit()
    }


def _read(path: str) -> str:
    """Read a short file of the kernel, in half the time of `Path.read_text`. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        return os.read(descriptor, _MOST_BYTES).decode()
    finally:
        os.close(descriptor)


# --- folders of the cgroups


@lru_cache(maxsize=4)
def _places(cgroups: str, proc: str) -> tuple[tuple[str, _Kind], ...]:
    """The folders of the memory cgroups that /proc/PID/cgroup names, and of their parents.

    Raises OSError.
    """
    paths: dict[_Kind, str] = {}
    for line in cgroups.splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers:
            paths[_V2] = path
        elif "memory" in controllers.split(","):
            paths[_V1] = path
    found: list[tuple[str, _Kind]] = []
    with open(f"{proc}/self/mountinfo") as file:  # noqa: PTH123 - and it may be long
        lines = file.read().splitlines()
    for line in lines:
        before, _, after = line.partition(" - ")
        fields, (system, _, options) = before.split(), after.split(maxsplit=2)
        kind = {"cgroup2": _V2, "cgroup": _V1}.get(system)
        if kind is _V1 and "memory" not in options.split(","):
            continue
        if kind is not None and kind in paths:
            root, place = (_unescaped(field) for field in fields[3:5])
            found += [(folder, kind) for folder in _with_parents(place, root, paths.pop(kind))]
    return tuple(found)


def _with_parents(mount: str, root: str, path: str) -> list[str]:
    """The folder of the cgroup `path`, and its parents; the cgroup `root` is mounted at `mount`."""
    parts, above = _parts(path), _parts(root)
    # If it is not below `root`, only the topmost folder is visible here.
    parts = parts[len(above) :] if parts[: len(above)] == above else []
    folders = ["/".join((mount, *parts[:depth])) for depth in range(len(parts), -1, -1)]
    # A cgroup of version 1 may not include the memory of its children.
    alone = next((at for at, one in enumerate(folders) if at and _is_alone(one)), len(folders))
    return folders[:alone]


def _is_alone(folder: str) -> bool:
    return _number(f"{folder}/memory.use_hierarchy") == 0


def _parts(path: str) -> list[str]:
    return [part for part in path.split("/") if part]


def _unescaped(text: str) -> str:
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), text)

"""The last number of each route in, in a file that outlives the process.

A bridge that was killed, and is back, finds there which messages it has missed. The file is mapped into
memory: a note costs no system call, and a kill loses none. Times are of the monotonic clock, so a start of
the machine makes the notes void. Must not know routes, the engine and the graph.
"""

import errno
import fcntl
import mmap
import os
import stat
import struct
from hashlib import sha256
from pathlib import Path

from bus_bridge.core.accounts import Account
from bus_bridge.core.pasts import Past

__all__ = ["Entry", "Journal"]

_HEAD = struct.Struct("<8s16sq")
"""Mark of the format, the start of the machine, time of the last sign of life."""
_MARK = b"busdway1"
_SIGN = struct.Struct("<q")
_SIGN_AT = 24
_HEAD_BYTES = 64
_LISTENERS = 8
_ENTRY = struct.Struct(f"<16sQqQ{16 * _LISTENERS}s")
"""Gid, number and time of the last message, number of listeners, their gids."""
_LAST = struct.Struct("<Qq")
_LAST_AT = 16
_GIDS = struct.Struct(f"<Q{16 * _LISTENERS}s")
_GIDS_AT = 32
_MOST = 4096
_KEEP_NS = 600 * 1_000_000_000
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Journal:
    """The open file at `path`. `now_ns` is the time of the monotonic clock, as in all methods.

    Raises OSError if the file can't be made, belongs to another user, or is open in another bridge.
    """

    def __init__(self, path: Path, now_ns: int, most: int = _MOST) -> None:
        size = _HEAD_BYTES + most * _ENTRY.size
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        file = os.open(path, flags, 0o600)
        try:
            _check_owner(os.fstat(file))
            # Until the map is closed, which duplicates `file`:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(file, size)
            # A write into a hole of a mapped file on a full disk would end the process by SIGBUS.
            os.posix_fallocate(file, 0, size)
            self._map = mmap.mmap(file, size)
        finally:
            os.close(file)
        boot = _boot()
        mark, last_boot, alive_ns = _HEAD.unpack_from(self._map)
        if not ((mark, last_boot) == (_MARK, boot) and 0 <= now_ns - alive_ns <= _KEEP_NS):
            self._map[:] = bytes(size)
        _HEAD.pack_into(self._map, 0, _MARK, boot, now_ns)
        self._left: dict[bytes, int] = {}
        """Places of the entries of earlier processes, by gid. They stay: this one may be killed soon, too."""
        self._free: list[int] = []
        for at in range(_HEAD_BYTES, size, _ENTRY.size):
            gid, last, *_ = _ENTRY.unpack_from(self._map, at)
            if last:
                self._left[gid] = at
            else:
                self._free.append(at)

    def take(self, gid: bytes) -> Past | None:
        """Remove and return the state in which an earlier process left the route of a publisher."""
        at = self._left.pop(gid, None)
        if at is None:
            return None
        _, last, newest_ns, count, gids = _ENTRY.unpack_from(self._map, at)
        _ENTRY.pack_into(self._map, at, b"", 0, 0, 0, b"")
        self._free.append(at)
        listeners = frozenset(
            gids[16 * number : 16 * number + 16] for number in range(min(count, _LISTENERS))
        )
        return Past(last, listeners, Account(), {}, newest_ns=newest_ns)

    def begin(self, gid: bytes) -> "Entry | None":
        """The entry for the route of a publisher. None if all entries are in use."""
        if not self._free and self._left:
            self._free.append(self._left.pop(next(iter(self._left))))
        return Entry(self._map, self._free, gid) if self._free else None

    def live(self, now_ns: int) -> None:
        """Note a sign of life. Without one for ten minutes, the notes are void at the next start."""
        _SIGN.pack_into(self._map, _SIGN_AT, now_ns)

    def close(self) -> None:
        """Close the file. The notes stay for the next process."""
        self._map.close()


class Entry:
    """The notes about the route of one publisher."""

    __slots__ = ("_at", "_free", "_map")

    def __init__(self, mapped: mmap.mmap, free: list[int], gid: bytes) -> None:
        self._map = mapped
        self._free = free
        self._at = free.pop()
        _ENTRY.pack_into(mapped, self._at, gid, 0, 0, 0, b"")

    def note(self, last: int, newest_ns: int) -> None:
        """Note the last message: its number, and its time by the publisher's clock."""
        _LAST.pack_into(self._map, self._at + _LAST_AT, last, newest_ns)

    def note_listeners(self, gids: frozenset[bytes]) -> None:
        """Note which subscriptions get the messages: the first eight, of which one is enough."""
        some = sorted(gids)[:_LISTENERS]
        _GIDS.pack_into(self._map, self._at + _GIDS_AT, len(some), b"".join(some))

    def end(self) -> None:
        """Forget the route."""
        _ENTRY.pack_into(self._map, self._at, b"", 0, 0, 0, b"")
        self._free.append(self._at)


def _check_owner(status: os.stat_result) -> None:
    """Raise PermissionError if another user could cut the file, which would end this process by SIGBUS."""
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(errno.EPERM, "other users may write it")


def _boot() -> bytes:
    """Bytes that differ for each start of the machine."""
    try:
        return sha256(_BOOT_ID.read_bytes()).digest()[:16]
    except OSError:  # not on Linux
        return bytes(16)

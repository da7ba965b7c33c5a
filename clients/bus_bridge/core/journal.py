"""The last number of each route in, in a file that outlives the process.

A bridge that was killed, and is back, finds there which messages it has missed. The file is mapped into
memory: a note costs no system call, and a kill loses none. Times are of the monotonic clock, so a start of
the machine makes the notes void. Must not know routes, the engine and the graph.
"""

import fcntl
import mmap
import os
import struct
from collections.abc import Iterable
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
_WHO = struct.Struct(f"<Q{16 * _LISTENERS}s")
_WHO_AT = 32
_MOST = 4096
_KEEP_NS = 600 * 1_000_000_000
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Journal:
    """The open file at `path`. `now_ns` is the time of the monotonic clock, as in all methods.

    Raises OSError if the file can't be made, or if another bridge has it open.
    """

    def __init__(self, path: Path, now_ns: int, most: int = _MOST) -> None:
        size = _HEAD_BYTES + most * _ENTRY.size
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        file = os.open(path, flags, 0o600)
        try:
            fcntl.flock(
                file, fcntl.LOCK_EX | fcntl.LOCK_NB
            )  # until the map is closed, which duplicates `file`
            os.ftruncate(file, size)
            # A write into a hole of a mapped file on a full disk would end the process by SIGBUS.
            os.posix_fallocate(file, 0, size)
            self._map = mmap.mmap(file, size)
        finally:
            os.close(file)
        boot = _boot()
        mark, last_boot, alive_ns = _HEAD.unpack_from(self._map)
        is_valid = (mark, last_boot) == (_MARK, boot) and 0 <= now_ns - alive_ns <= _KEEP_NS
        self._left = dict(self._read(most)) if is_valid else {}
        """States of routes of the last process, by gid."""
        self._map[:] = bytes(size)
        _HEAD.pack_into(self._map, 0, _MARK, boot, now_ns)
        self._free = [_HEAD_BYTES + number * _ENTRY.size for number in reversed(range(most))]

    def take(self, gid: bytes) -> Past | None:
        """Remove and return the state in which the last process left the route of a publisher."""
        return self._left.pop(gid, None)

    def begin(self, gid: bytes) -> "Entry | None":
        """The entry for the route of a publisher. None if all entries are in use."""
        return Entry(self._map, self._free, gid) if self._free else None

    def live(self, now_ns: int) -> None:
        """Note a sign of life. Without one for ten minutes, the notes are void at the next start."""
        _SIGN.pack_into(self._map, _SIGN_AT, now_ns)

    def close(self) -> None:
        """Close the file. The notes stay for the next process."""
        self._map.close()

    def _read(self, most: int) -> Iterable[tuple[bytes, Past]]:
        for number in range(most):
            gid, last, newest_ns, count, gids = _ENTRY.unpack_from(
                self._map, _HEAD_BYTES + number * _ENTRY.size
            )
            if not last:
                continue
            listeners = frozenset(gids[16 * at : 16 * at + 16] for at in range(min(count, _LISTENERS)))
            yield gid, Past(last, listeners, Account(), {}, newest_ns=newest_ns)


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
        _WHO.pack_into(self._map, self._at + _WHO_AT, len(some), b"".join(some))

    def end(self) -> None:
        """Forget the route."""
        _ENTRY.pack_into(self._map, self._at, b"", 0, 0, 0, b"")
        self._free.append(self._at)


def _boot() -> bytes:
    """Bytes that differ for each start of the machine."""
    try:
        return sha256(_BOOT_ID.read_bytes()).digest()[:16]
    except OSError:  # not on Linux
        return bytes(16)

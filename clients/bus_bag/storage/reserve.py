"""Reserves space on the disk for the end of a file."""

import os
from pathlib import Path

__all__ = ["UNIT", "Reserve"]

UNIT = 1 << 20
"""The reserve is a multiple of this number of bytes."""


class Reserve:
    """Reserved space in the file system of `folder`: a file without a name, so a crash leaves nothing
    behind."""

    def __init__(self, folder: Path) -> None:
        self._size = 0
        try:
            self._descriptor = os.open(folder, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600)
        except (OSError, AttributeError):
            self._descriptor = -1  # the system has no such files: the bag's last chunks make room
        self.hold(0)

    @property
    def size(self) -> int:
        """The reserved bytes."""
        return self._size

    def hold(self, size: int) -> None:
        """Reserve space for a summary of `size` bytes, and for the metadata, which has the length of a part
        of it."""
        wanted = -(-3 * size // UNIT) * UNIT or UNIT
        if self._descriptor < 0 or wanted <= self._size:
            return
        try:
            os.posix_fallocate(self._descriptor, 0, wanted)
        except (OSError, AttributeError):
            return
        self._size = wanted

    def give_back(self) -> bool:
        """Free the space; False if there was none."""
        if self._descriptor < 0:
            return False
        os.close(self._descriptor)
        self._descriptor = -1
        size, self._size = self._size, 0
        return size > 0

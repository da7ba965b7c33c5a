"""The files of a bag during writing, one after the other."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from bus_bag.metadata import FileInformation
from bus_bag.storage.bag_file import BagFileWriter
from bus_bag.storage.registry import WritableStorage

__all__ = ["BagFiles"]


class BagFiles:
    """Files of `storage` in `folder`: `<folder>_0.mcap` and so on. With more than `most_files`, the oldest
    file is deleted; 0: no limit.

    Not for several threads at a time, but any thread may read `size` and `counts`. Raises BagError or OSError
    if the first file can't be made.
    """

    def __init__(self, folder: Path, storage: WritableStorage, preset: str, most_files: int) -> None:
        self._folder = folder
        self._storage = storage
        self._preset = preset
        self._most_files = most_files
        self._closed: list[tuple[FileInformation, Mapping[int, int]]] = []
        """For each closed file that still exists: its information, and channel -> number of messages."""
        self._number = 0
        self._past: Counter[int] = Counter()
        """Channel -> number of messages in all closed files, including deleted ones."""
        self._deleted: Counter[int] = Counter()
        self._past_size = 0
        self.present = self._open()
        """The last file; it may be closed."""

    @property
    def size(self) -> int:
        """Bytes in all files."""
        return self._past_size + (self.present.size if self.present.is_open else 0)

    def counts(self) -> Counter[int]:
        """Channel -> number of messages in all files, including deleted ones."""
        counts = Counter(self._past)
        if self.present.is_open:
            counts.update(self.present.counts)
        return counts

    def counts_there(self) -> Counter[int]:
        """Channel -> number of messages in existing files."""
        counts = self.counts()
        counts.subtract(self._deleted)
        return counts

    def information(self) -> list[FileInformation]:
        """For each file that still exists."""
        closed = [one for one, _ in self._closed]
        return [*closed, self._describe_present()] if self.present.is_open else closed

    def close(self) -> None:
        """Close the last file, which is open. It is closed even if that fails."""
        file = self.present
        try:
            file.close()
        finally:
            counts = dict(file.counts)
            self._closed.append((self._describe_present(), counts))
            self._past.update(counts)
            self._past_size += file.size

    def open_next(self) -> None:
        """Open a further file. Before that, delete the oldest files to make room for it."""
        while self._most_files and len(self._closed) >= self._most_files:
            oldest, counts = self._closed[0]
            (self._folder / oldest.path).unlink(missing_ok=True)
            del self._closed[0]
            self._deleted.update(counts)
        self._number += 1
        self.present = self._open()

    def _open(self) -> BagFileWriter:
        name = f"{self._folder.name}_{self._number}{self._storage.suffix}"
        return self._storage.create(self._folder / name, self._preset)

    def _describe_present(self) -> FileInformation:
        file = self.present
        return FileInformation(
            file.path.name, file.starting_time, file.end_time - file.starting_time, file.message_count
        )

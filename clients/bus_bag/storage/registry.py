"""The storages: formats of the files of bags, by the suffix of these files.

The rest of bus_bag and the command line ask here, and know no format. docs/architecture.md explains how to
add a storage. `bus bag record --help` loads this module, too. So a storage imports packages when it is used.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from bus_bag.errors import BagError
from bus_bag.metadata import BagMetadata
from bus_bag.storage.bag_file import BagFile, BagFileWriter, Gatherer
from bus_bag.storage.mcap_storage import McapStorage
from bus_bag.storage.sqlite_storage import SqliteStorage

__all__ = [
    "DEFAULT",
    "Storage",
    "WritableStorage",
    "find_storage",
    "register",
    "storage_of",
    "storages",
    "suffix_list",
    "writable_storage",
    "writable_storages",
]


@runtime_checkable
class Storage(Protocol):
    """A format of files from which bags are read."""

    @property
    def identifier(self) -> str:
        """Its name in metadata.yaml and for `--storage`."""
        ...

    @property
    def suffix(self) -> str:
        """The end of the names of its files, with the dot."""
        ...

    @property
    def magic(self) -> bytes:
        """The first bytes of its files, to recognize files with other names."""
        ...

    def open(self, path: Path, content: Path | None = None) -> BagFile:
        """Open the file `path` for reading. With `content`, its bytes are in that file, perhaps only during
        this call.

        Raises BagError if it does not have this format, OSError if it can't be opened.
        """
        ...

    def repair(self, file: BagFile, metadata: BagMetadata) -> list[str] | None:
        """Write a file again if it lacks its end or its index; `metadata`: of the bag.

        Returns texts about parts that were left out; None if there was nothing to do.
        """
        ...


@runtime_checkable
class WritableStorage(Storage, Protocol):
    """A format of files to which bags are also written."""

    @property
    def presets(self) -> Sequence[str]:
        """Presets for `--storage-preset-profile`; `none` is one of them, and the default."""
        ...

    def check(self) -> None:
        """Raises BagError if a package that writing needs is missing."""
        ...

    def chunk_bytes(self, preset: str) -> int:
        """Number of bytes of messages to gather before writing."""
        ...

    def gather(self) -> Gatherer:
        """Make a Gatherer for messages."""
        ...

    def create(self, path: Path, preset: str) -> BagFileWriter:
        """Start a file for gathered messages. Raises BagError or OSError if it can't be made."""
        ...


DEFAULT = McapStorage()
"""The storage for new bags, if the user does not choose another."""

_storages: dict[str, Storage] = {one.suffix: one for one in (DEFAULT, SqliteStorage())}
"""Storages by suffix."""


def register(storage: Storage) -> None:
    """Register a storage to read bags, and also to write them if it is a WritableStorage."""
    _storages[storage.suffix] = storage


def storages() -> list[Storage]:
    """All storages."""
    return list(_storages.values())


def writable_storages() -> list[WritableStorage]:
    """The storages to which bags can be written."""
    return [one for one in _storages.values() if isinstance(one, WritableStorage)]


def writable_storage(identifier: str) -> WritableStorage:
    """The storage of this name. Raises BagError if there is none, or if it can only be read."""
    writable = {one.identifier: one for one in writable_storages()}
    if identifier not in writable:
        valid = " or ".join(f"'{name}'" for name in writable)
        raise BagError(f"storage_id '{identifier}' can't be written; bags are written as {valid}")
    return writable[identifier]


def find_storage(suffix: str) -> Storage | None:
    """The storage with this suffix."""
    return _storages.get(suffix)


def storage_of(path: Path) -> Storage:
    """The storage of a file by its suffix. If no storage has that suffix, by the file's first bytes."""
    known = _storages.get(path.suffix)
    if known is not None:
        return known
    with path.open("rb") as file:
        head = file.read(max(len(one.magic) for one in _storages.values()))
    return next((one for one in _storages.values() if head.startswith(one.magic)), DEFAULT)


def suffix_list() -> str:
    """The suffixes as a text for users: `.mcap or .db3`."""
    return " or ".join(_storages)

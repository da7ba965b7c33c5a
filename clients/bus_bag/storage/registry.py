"""The storages: formats of the files of bags, by the suffix of these files.

The rest of bus_bag and the command line ask here, and know no format. docs/architecture.md says how a storage
is added. `bus bag record --help` loads this module, too, so a storage imports what it needs when it is used.
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
    """A format of files that bags are read from."""

    @property
    def identifier(self) -> str:
        """Its name in metadata.yaml and for `--storage`."""
        ...

    @property
    def suffix(self) -> str:
        """How the names of its files end, with the dot."""
        ...

    @property
    def magic(self) -> bytes:
        """How its files begin: those with other names are recognized by it."""
        ...

    def open(self, path: Path, content: Path | None = None) -> BagFile:
        """Open the file `path` to read it. With `content` its bytes are there, perhaps only for this call.

        Raises BagError if it is no such file, OSError if it can't be opened.
        """
        ...

    def repair(self, file: BagFile, metadata: BagMetadata) -> list[str] | None:
        """Write one of its files anew if that lacks its end or its index; `metadata`: of the bag.

        Returns what was left out, as texts; None if there was nothing to do.
        """
        ...


@runtime_checkable
class WritableStorage(Storage, Protocol):
    """A format of files that bags are also written to."""

    @property
    def presets(self) -> Sequence[str]:
        """Ways to write a file, for `--storage-preset-profile`; `none` is one of them, and the default."""
        ...

    def check(self) -> None:
        """Raises BagError if a package that writing needs is missing."""
        ...

    def chunk_bytes(self, preset: str) -> int:
        """So many bytes of messages are gathered before they are written."""
        ...

    def gather(self) -> Gatherer:
        """Gathers messages before they are written."""
        ...

    def create(self, path: Path, preset: str) -> BagFileWriter:
        """Begin a file, for what was gathered. Raises BagError or OSError if it can't be made."""
        ...


DEFAULT = McapStorage()
"""The storage for new bags, unless the user asks for another."""

_storages: dict[str, Storage] = {one.suffix: one for one in (DEFAULT, SqliteStorage())}
"""By suffix."""


def register(storage: Storage) -> None:
    """Have bags read from files of this storage, and written to them if it is a WritableStorage."""
    _storages[storage.suffix] = storage


def storages() -> list[Storage]:
    """All of them."""
    return list(_storages.values())


def writable_storages() -> list[WritableStorage]:
    """Those that bags can be written to."""
    return [one for one in _storages.values() if isinstance(one, WritableStorage)]


def writable_storage(identifier: str) -> WritableStorage:
    """The storage of this name. Raises BagError if there is none, or if it can only be read."""
    writable = {one.identifier: one for one in writable_storages()}
    if identifier not in writable:
        valid = " or ".join(f"'{name}'" for name in writable)
        raise BagError(f"storage_id '{identifier}' can't be written; bags are written as {valid}")
    return writable[identifier]


def find_storage(suffix: str) -> Storage | None:
    """The storage whose files have this suffix."""
    return _storages.get(suffix)


def storage_of(path: Path) -> Storage:
    """The storage of a file: by its suffix or, if no storage has that, by how it begins."""
    known = _storages.get(path.suffix)
    if known is not None:
        return known
    with path.open("rb") as file:
        head = file.read(max(len(one.magic) for one in _storages.values()))
    return next((one for one in _storages.values() if head.startswith(one.magic)), DEFAULT)


def suffix_list() -> str:
    """The suffixes, for people: `.mcap or .db3`."""
    return " or ".join(_storages)

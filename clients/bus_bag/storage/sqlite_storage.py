"""SQLite as a storage: reads bags of ROS 2 before Iron. It does not write bags."""

from pathlib import Path
from typing import TYPE_CHECKING

from bus_bag.metadata import BagMetadata
from bus_bag.storage.bag_file import BagFile

if TYPE_CHECKING:
    from bus_bag.storage.sqlite_reader import SqliteFile

__all__ = ["SqliteStorage"]


class SqliteStorage:
    """See `Storage`."""

    identifier = "sqlite3"
    suffix = ".db3"
    magic = b"SQLite"

    def open(self, path: Path, content: Path | None = None) -> "SqliteFile":
        from bus_bag.storage.sqlite_reader import SqliteFile

        return SqliteFile(path, content)

    def repair(self, file: BagFile, metadata: BagMetadata) -> None:
        """Nothing to do: SQLite repairs its files itself."""

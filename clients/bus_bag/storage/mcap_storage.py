"""MCAP as a storage, for reading and writing bags."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bus.base.counted import counted
from bus_bag.metadata import BagMetadata
from bus_bag.storage.bag_file import BagFile
from bus_bag.storage.mcap_format import MAGIC, package

if TYPE_CHECKING:
    from bus_bag.storage.chunk import ChunkBuilder
    from bus_bag.storage.mcap_reader import McapFile
    from bus_bag.storage.mcap_writer import McapWriter

__all__ = ["McapStorage"]

_UNCHUNKED = 1 << 20
"""Number of bytes written at once in a file without chunks."""


class McapStorage:
    """See `WritableStorage`."""

    identifier = "mcap"
    suffix = ".mcap"
    magic = MAGIC
    presets: Sequence[str] = ("none", "fastwrite", "zstd_fast", "zstd_small")

    def open(self, path: Path, content: Path | None = None) -> "McapFile":
        from bus_bag.storage.mcap_reader import McapFile

        return McapFile(path, content)

    def repair(self, file: BagFile, metadata: BagMetadata) -> list[str] | None:
        from bus_bag.storage.mcap_reader import McapFile
        from bus_bag.storage.rewriting import rewrite

        if not isinstance(file, McapFile) or file.has_message_index:
            return None
        rewrite(file, metadata)
        if not file.attachments:
            return []
        return [f"{counted(file.attachments, 'attachment', 'is', 'are')} left out"]

    def check(self) -> None:
        package()

    def chunk_bytes(self, preset: str) -> int:
        from bus_bag.storage.mcap_writer import PRESETS

        return PRESETS[preset].chunk_bytes or _UNCHUNKED

    def gather(self) -> "ChunkBuilder":
        from bus_bag.storage.chunk import ChunkBuilder

        return ChunkBuilder()

    def create(self, path: Path, preset: str) -> "McapWriter":
        from bus_bag.storage.mcap_writer import PRESETS, McapWriter

        return McapWriter(path, PRESETS[preset])

"""Bags compressed by rosbag2: a file as a whole (`x_0.mcap.zstd`), or each message (mode MESSAGE)."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bus.base.counted import counted
from bus_bag.errors import BagError
from bus_bag.storage.bag_file import BagFile, BagMessage, Problem
from bus_bag.storage.decompression import decompress_frame
from bus_bag.storage.mcap_format import package
from bus_bag.storage.registry import DEFAULT, find_storage

__all__ = ["SUFFIX", "decompress_messages", "open_compressed"]

SUFFIX = ".zstd"
_PIECE = 1 << 20
_LEAST = 64 << 20
_MOST_TIMES = 1000
"""A file that grows more in decompression is refused: it was made to fill the disk."""


def open_compressed(path: Path) -> BagFile:
    """Open a compressed file, from a temporary decompressed copy. Raises BagError if it is not valid."""
    inner = path.with_suffix("").suffix
    with tempfile.NamedTemporaryFile(prefix="busd_bag_", suffix=inner) as file:
        _decompress_file(path, file.fileno())
        return (find_storage(inner) or DEFAULT).open(path, Path(file.name))


def _decompress_file(path: Path, target: int) -> None:
    zstd = package("zstandard")
    most = max(path.stat().st_size * _MOST_TIMES, _LEAST)
    size = 0
    try:
        with path.open("rb") as source:
            for piece in zstd.ZstdDecompressor().read_to_iter(source, write_size=_PIECE):
                size += len(piece)
                if size > most:
                    raise BagError(f"'{path}' would be more than {most:,} bytes unpacked")
                while piece:
                    piece = piece[os.write(target, piece) :]
    except zstd.ZstdError as error:
        raise BagError(f"'{path}' can't be unpacked: {error}") from None
    if not size:
        raise BagError(f"'{path}' can't be unpacked: there is nothing in it")


def decompress_messages(
    messages: Iterator[BagMessage], path: Path, problems: list[Problem]
) -> Iterator[BagMessage]:
    """Decompress messages one by one; counts and skips messages that can't be decompressed."""
    passed_over, why = 0, ""
    for message in messages:
        try:
            message.data = decompress_frame(message.data)
        except ValueError as error:
            passed_over += 1
            why = str(error)
            continue
        yield message
    if passed_over:
        text = f"{counted(passed_over, 'message', 'is', 'are')} skipped: unpacking fails ({why})"
        problem = Problem(str(path), None, text)
        if problem not in problems:
            problems.append(problem)

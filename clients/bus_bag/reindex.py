"""`bus bag reindex`: writes metadata.yaml again, and repairs files without an index or an end."""

from collections.abc import Callable
from pathlib import Path

import msgspec

from bus.base.counted import counted
from bus_bag.errors import BagError
from bus_bag.metadata import NAME, VERSION
from bus_bag.storage import BagReader, Problem
from bus_bag.storage.registry import find_storage
from bus_bag.storage.writer import write_metadata_file

__all__ = ["reindex"]


def reindex(folder: Path, say: Callable[[str], object]) -> list[Problem]:
    """Repair a bag. Reports each step to `say`; returns the problems: unreadable parts, which are lost.

    Each file is replaced when its new version is on the disk, and metadata.yaml at the end. Raises BagError
    if there is no bag, or if it can't be written; OSError for faults of the disk.
    """
    if not folder.exists():
        raise BagError(f"Bag path '{folder}' does not exist!")
    if not folder.is_dir():
        raise BagError("Must specify a bag directory")
    lost: list[Problem] = []
    with BagReader(folder, all_files=True) as reader:
        for file in reader.files:
            storage = find_storage(file.path.suffix)  # no storage has the suffix of a compressed file
            left_out = None if storage is None else storage.repair(file, reader.metadata)
            if left_out is None:
                continue
            lost += file.problems
            lost += [Problem(str(file.path), None, text) for text in left_out]
            messages = counted(file.summary.message_count, "message")
            say(f"{file.path.name}: rewritten with an index, {messages}")
    with BagReader(folder, all_files=True) as reader:
        write_metadata_file(folder, msgspec.structs.replace(reader.metadata, version=VERSION))
        messages = counted(reader.metadata.message_count, "message")
        say(f"{NAME}: {messages} in {counted(len(reader.files), 'file')}")
        return lost + [problem for problem in reader.problems if not problem.path.endswith(NAME)]

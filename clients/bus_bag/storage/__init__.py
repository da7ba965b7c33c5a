"""Bags on disk: writes folders of MCAP files, and reads folders of MCAP or SQLite files.

    write   `writer.py` -> `bag_files.py` -> `mcap_writer.py` (`chunk.py`, `mcap_summary.py`, `reserve.py`)
    read    `reader.py` -> `mcap_reader.py` (`mcap_bytes.py`) or `sqlite_reader.py`, in order by `merge.py`;
            `joined.py` reads several bags as one
    gaps    `stretches.py`
    which   `registry.py` -> `mcap_storage.py`, `sqlite_storage.py`;  `compressed.py`, `decompression.py`

Invariants:

- Only the storages know a format. Everything else uses `bag_file.py` and `registry.py`.
- A file may contain any bytes. Reading it ends, raises only BagError, and keeps one chunk and the index in
  memory. Unreadable parts become a Problem and are skipped. Decompression is limited.
- Writing only appends. A part of the disk is reserved, so a full disk still allows a proper end.
- `chunk.py` is the hot path of recording: long payloads are never joined or copied.
- Heavy packages are imported inside methods, because `bus bag record --help` loads the registry.

docs/architecture.md, "How to add", explains how to add a storage.

Read first: `bag_file.py`, then `registry.py`.

Tests: `tests/unit/bus_bag/storage/`, `tests/property/test_bag_damage.py`.
"""

from bus_bag.storage.bag_file import BagMessage, Order, Problem
from bus_bag.storage.joined import JoinedBags, open_bags
from bus_bag.storage.reader import BagReader, open_bag
from bus_bag.storage.stretches import Stretch
from bus_bag.storage.writer import BagWriter

__all__ = [
    "BagMessage",
    "BagReader",
    "BagWriter",
    "JoinedBags",
    "Order",
    "Problem",
    "Stretch",
    "open_bag",
    "open_bags",
]

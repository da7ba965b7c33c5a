"""Metadata of bags that are not open."""

from pathlib import Path

from bus_bag.rosbag2_py._storage import BagMetadata, metadata_of, with_errors_of_ros
from bus_bag.storage import open_bag

__all__ = ["Info"]


class Info:
    """Reads the metadata of bags."""

    def read_metadata(self, uri: str, storage_id: str) -> BagMetadata:
        """The metadata of the bag in the folder, or file, `uri`; busd finds its storage itself."""
        with with_errors_of_ros(), open_bag(Path(uri)) as reader:
            return metadata_of(reader)

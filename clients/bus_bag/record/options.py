"""The options of a recording, as values."""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from bus.qos import QoSProfile
from bus_bag.record.choice import Wanted
from bus_bag.storage.registry import DEFAULT

__all__ = ["RecordOptions"]


class RecordOptions(msgspec.Struct, frozen=True, kw_only=True):
    """The options of `bus bag record`."""

    folder: Path
    wanted: Wanted
    overrides: Mapping[str, QoSProfile] = {}
    """Topic -> profile for its subscription."""
    has_discovery: bool = True
    """Whether topics that appear later are recorded, too."""
    max_bag_size: int = 0
    """Number of bytes after which a further file begins; 0: never."""
    max_bag_duration: float = 0.0
    """Number of seconds after which a further file begins; 0: never."""
    max_bag_files: int = 0
    """Above this number, the oldest files are deleted; 0: never."""
    max_cache_size: int = 100 << 20
    """Most bytes that may wait; 0: no cache, messages are written when taken, and wait in the
    subscriptions."""
    storage: str = DEFAULT.identifier
    preset: str = "none"
    is_paused: bool = False
    is_simulated: bool = False
    """Whether log times come from the topic /clock."""
    is_snapshot: bool = False
    """Whether to keep only the newest messages, and write them when the service `snapshot` is called."""
    custom_data: Mapping[str, str] = {}
    node_name: str = "rosbag2_recorder"
    progress_hz: float = 3.0
    """Frequency of the line of progress; 0: never."""
    has_keys: bool = True

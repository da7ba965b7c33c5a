"""What a recording is asked to do, as values."""

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
    """Topic -> the profile to subscribe with."""
    has_discovery: bool = True
    """Whether topics that come later are recorded too."""
    max_bag_size: int = 0
    """Bytes after which a further file begins; 0: never."""
    max_bag_duration: float = 0.0
    """Seconds after which a further file begins; 0: never."""
    max_bag_files: int = 0
    """The oldest files beyond are deleted; 0: none."""
    max_cache_size: int = 100 << 20
    """Bytes that may wait; 0: messages are written as they are taken, and wait in the subscriptions."""
    storage: str = DEFAULT.identifier
    preset: str = "none"
    is_paused: bool = False
    is_simulated: bool = False
    """Whether log times are those of the topic /clock."""
    is_snapshot: bool = False
    """Whether the newest messages are kept, and only written when the service `snapshot` is called."""
    custom_data: Mapping[str, str] = {}
    node_name: str = "rosbag2_recorder"
    progress_hz: float = 3.0
    """How often the line of progress is written; 0: never."""
    has_keys: bool = True

"""`message_filters` on the bus: messages of several topics brought together by their stamps.

Owns: the filters of ROS 2 Jazzy's Python, and those of Rolling that compare messages. Which messages belong
together is decided in `matching`, which knows neither messages nor clocks.

    `subscriber.py` -> `chain.py`, `cache.py`, `delta_filter.py`, `time_synchronizer.py` -> callbacks

Invariants: a filter derives from `SimpleFilter` (`simple_filter.py`); queues are bounded; a message goes out
at most once; results are those of ROS 2's filters for the same input.

Read first: `matching.py`, then `time_synchronizer.py`. Tests: `tests/unit/bus_ros/message_filters/`,
`tests/property/test_message_filters.py`, `tests/system/test_message_filters.py`.
"""

from bus_ros.message_filters.cache import Cache
from bus_ros.message_filters.chain import Chain
from bus_ros.message_filters.delta_filter import (
    CachedComparisonHandler,
    ComparisonFilter,
    ComparisonHandler,
    DeltaCompare,
    DeltaFilter,
    PathDeltaFilter,
)
from bus_ros.message_filters.simple_filter import SimpleFilter
from bus_ros.message_filters.subscriber import Subscriber
from bus_ros.message_filters.time_synchronizer import ApproximateTimeSynchronizer, TimeSynchronizer

__all__ = [
    "ApproximateTimeSynchronizer",
    "Cache",
    "CachedComparisonHandler",
    "Chain",
    "ComparisonFilter",
    "ComparisonHandler",
    "DeltaCompare",
    "DeltaFilter",
    "PathDeltaFilter",
    "SimpleFilter",
    "Subscriber",
    "TimeSynchronizer",
]

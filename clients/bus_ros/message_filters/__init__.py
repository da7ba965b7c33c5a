"""`message_filters` on the bus: synchronizes messages of several topics by their stamps.

Owns: the filters of ROS 2 Jazzy's Python, and Rolling's filters that compare messages. `matching` decides
which messages belong together; it knows neither messages nor clocks.

    `subscriber.py` -> `chain.py`, `cache.py`, `delta_filter.py`, `time_synchronizer.py` -> callbacks

Invariants: a filter derives from `SimpleFilter` (`simple_filter.py`); queues are bounded; a message goes out
at most once; for the same input, the results are the same as in ROS 2.

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

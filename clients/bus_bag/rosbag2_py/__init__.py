"""`rosbag2_py` on the bus: programs read and write bags without the command line.

    `_storage.py`   options, filters and metadata: plain values
    `_reader.py`    SequentialReader, on `bus_bag.storage.reader`
    `_writer.py`    SequentialWriter, on `bus_bag.storage.writer`
    `_info.py`      Info

Invariants: names, arguments and results are the same as in ROS 2's package (rosbag2_py of rosbag2).
Messages that are read are CDR. All errors are RuntimeError, as they are there. No other package of bags
knows rclpy (times, QoS).

Read first: `_reader.py`. Tests: `tests/unit/bus_bag/rosbag2_py/`.
"""

from bus_bag.rosbag2_py._info import Info
from bus_bag.rosbag2_py._reader import SequentialReader, get_registered_readers
from bus_bag.rosbag2_py._storage import (
    BagMetadata,
    ConverterOptions,
    FileInformation,
    MessageDefinition,
    ReadOrder,
    ReadOrderSortBy,
    StorageFilter,
    StorageOptions,
    TopicInformation,
    TopicMetadata,
    convert_rclcpp_qos_to_rclpy_qos,
    get_default_storage_id,
)
from bus_bag.rosbag2_py._writer import SequentialWriter, get_registered_writers

__all__ = [
    "BagMetadata",
    "ConverterOptions",
    "FileInformation",
    "Info",
    "MessageDefinition",
    "ReadOrder",
    "ReadOrderSortBy",
    "SequentialReader",
    "SequentialWriter",
    "StorageFilter",
    "StorageOptions",
    "TopicInformation",
    "TopicMetadata",
    "convert_rclcpp_qos_to_rclpy_qos",
    "get_default_storage_id",
    "get_registered_readers",
    "get_registered_writers",
]

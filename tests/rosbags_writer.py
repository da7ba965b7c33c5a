"""Bags written by the package `rosbags`."""

from pathlib import Path

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bags import CHATTER, START, STRING, Said, cdr

INFINITE = QosTime(9223372036, 854775807)
LATCHED_QOS = Qos(
    QosHistory.KEEP_LAST,
    3,
    QosReliability.BEST_EFFORT,
    QosDurability.TRANSIENT_LOCAL,
    INFINITE,
    QosTime(10, 500_000_000),
    QosLiveliness.AUTOMATIC,
    INFINITE,
    False,
)
"""The QoS of the only publisher in such bags."""


def write_as_rosbags(
    folder: Path,
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    version: int = 9,
    mode: CompressionMode = CompressionMode.NONE,
) -> list[Said]:
    types = get_typestore(Stores.ROS2_JAZZY)
    messages = [Said(START + number, START + number, 0, CHATTER.name, f"{number}") for number in range(100)]
    writer = Writer(folder, version=version, storage_plugin=plugin)  # type: ignore[arg-type]
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(
            CHATTER.name, STRING, typestore=types, offered_qos_profiles=[LATCHED_QOS]
        )
        for one in messages:
            writer.write(connection, one.log_time, cdr(one.text))
    return messages

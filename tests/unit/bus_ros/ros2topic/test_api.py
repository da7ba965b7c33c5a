"""Arguments of tools: numbers, and QoS by names."""

from argparse import ArgumentParser, ArgumentTypeError

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPresetProfiles,
    ReliabilityPolicy,
)
from bus_ros.ros2topic import api
from rows import for_each


def test_a_profile_by_names() -> None:
    profile = api.qos_profile_from_short_keys(
        "sensor_data",
        reliability="reliable",
        durability="transient_local",
        depth=7,
        history="keep_all",
        liveliness="manual_by_topic",
        liveliness_lease_duration_s=1.5,
    )
    assert profile.reliability is ReliabilityPolicy.RELIABLE
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_ALL, 7)
    assert profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC
    assert profile.liveliness_lease_duration == Duration(seconds=1.5)


def test_the_preset_stays_as_it_is() -> None:
    changed = api.qos_profile_from_short_keys("sensor_data", depth=9)
    assert changed.depth == 9
    assert QoSPresetProfiles.SENSOR_DATA.value.depth == 5
    assert api.qos_profile_from_short_keys("sensor_data") == QoSPresetProfiles.SENSOR_DATA.value


def test_a_depth_for_latched_topics() -> None:
    assert QoSPresetProfiles.SYSTEM_DEFAULT.value.depth == 0
    assert api.qos_profile_from_short_keys("system_default", durability="transient_local").depth == 1
    with pytest.raises(KeyError):
        api.qos_profile_from_short_keys("fastest")


def test_options_of_a_profile() -> None:
    parser = ArgumentParser()
    api.add_qos_arguments(parser, "subscribe", "sensor_data")
    args = parser.parse_args(["--qos-depth", "3", "--qos-reliability", "reliable"])
    assert (args.qos_profile, args.qos_depth, args.qos_reliability) == ("sensor_data", 3, "reliable")
    assert (args.qos_history, args.qos_durability, args.qos_liveliness) == (None, None, None)
    assert args.qos_liveliness_lease_duration_seconds is None
    assert "the preset to subscribe with (default: sensor_data)" in " ".join(parser.format_help().split())
    with pytest.raises(SystemExit):
        parser.parse_args(["--qos-profile", "fastest"])


def test_numbers() -> None:
    assert (api.positive_int("3"), api.positive_float("0.5"), api.unsigned_int("0")) == (3, 0.5, 0)


@for_each(
    ("convert", "text", "fault"),
    [
        (api.positive_int, "0", "value must be a positive integer"),
        (api.positive_int, "x", "value must be a positive integer"),
        (api.positive_float, "0", "Value must be positive"),
        (api.positive_float, "x", "Expects a floating point number"),
    ],
)
def test_wrong_numbers(convert: type, text: str, fault: str) -> None:
    with pytest.raises(ArgumentTypeError, match=fault):
        convert(text)


def test_types_of_messages() -> None:
    types = api.message_type_completer()
    assert "std_msgs/msg/String" in types and "std_srvs/srv/Trigger" not in types

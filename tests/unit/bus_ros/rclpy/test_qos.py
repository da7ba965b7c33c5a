"""QoS of the facade: profiles, enums, presets, and their meaning on the bus."""

import warnings
from typing import Any

import pytest

from bus import qos as native
from bus_ros.rclpy import qos
from bus_ros.rclpy.duration import Duration, Infinite
from bus_ros.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    from_native,
    profile_of,
    qos_check_compatible,
    qos_policy_name_from_kind,
    to_native,
)
from rows import for_each


def test_a_depth_alone_is_keep_last_and_the_defaults() -> None:
    profile = QoSProfile(depth=3)
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_LAST, 3)
    assert profile.reliability is ReliabilityPolicy.RELIABLE
    assert profile.durability is DurabilityPolicy.VOLATILE
    assert profile.liveliness is LivelinessPolicy.SYSTEM_DEFAULT
    assert profile.deadline == profile.lifespan == profile.liveliness_lease_duration == Duration()
    assert profile.avoid_ros_namespace_conventions is False
    assert to_native(profile) == native.QoSProfile(depth=3)


def test_too_little_is_said() -> None:
    with pytest.raises(InvalidQoSProfileException, match=r"History and/or depth settings are required."):
        QoSProfile()
    with pytest.raises(InvalidQoSProfileException, match="History set to KEEP_LAST without a depth"):
        QoSProfile(history=HistoryPolicy.KEEP_LAST)
    assert QoSProfile(history=HistoryPolicy.KEEP_ALL).depth == 10


def test_zero_depth_warns_and_is_the_default() -> None:
    with pytest.warns(UserWarning, match="A zero depth with KEEP_LAST"):
        profile = QoSProfile(depth=0)
    assert to_native(profile) == native.default
    profile.depth = 5
    with pytest.warns(UserWarning, match="A zero depth with KEEP_LAST") as warned:
        profile.depth = 0
    assert [one.filename for one in warned] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=5).depth = 0


def test_values_of_the_wrong_kind() -> None:
    with pytest.raises(AssertionError, match="Invalid arguments"):
        QoSProfile(depth=1, reliabilty=ReliabilityPolicy.RELIABLE)
    with pytest.raises(AssertionError, match="depth must be a int"):
        QoSProfile(depth="10")
    with pytest.raises(AssertionError, match="reliability must be a ReliabilityPolicy"):
        QoSProfile(depth=1, reliability="reliable")
    with pytest.raises(AssertionError, match="deadline must be a Duration"):
        QoSProfile(depth=1, deadline=0.1)
    with pytest.raises(ValueError, match="9 is not a valid DurabilityPolicy"):
        QoSProfile(depth=1, durability=9)


def test_policies_can_be_set_afterwards_and_by_number() -> None:
    profile = QoSProfile(depth=1, reliability=2)
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    profile.history = HistoryPolicy.KEEP_ALL
    profile.durability = 1  # type: ignore[assignment]
    profile.deadline = Duration(seconds=0.5)
    profile.lifespan = Duration(seconds=2)
    profile.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
    profile.liveliness_lease_duration = Duration(seconds=3)
    assert to_native(profile) == native.QoSProfile(
        depth=1,
        history=native.History.KEEP_ALL,
        reliability=native.Reliability.BEST_EFFORT,
        durability=native.Durability.TRANSIENT_LOCAL,
        deadline=0.5,
        lifespan=2.0,
        liveliness=native.Liveliness.MANUAL_BY_TOPIC,
        liveliness_lease_duration=3.0,
    )


def test_equality_and_text() -> None:
    assert QoSProfile(depth=1) == QoSProfile(depth=1)
    assert QoSProfile(depth=1) != QoSProfile(depth=2)
    assert QoSProfile(depth=1) != 1
    assert str(QoSProfile(depth=1, deadline=Infinite)) == (
        "QoSProfile(history=1, depth=1, reliability=1, durability=2, lifespan=0 nanoseconds,"
        " deadline=Infinite, liveliness=0, liveliness_lease_duration=0 nanoseconds,"
        " avoid_ros_namespace_conventions=False)"
    )


def test_old_names_are_the_same_enums() -> None:
    assert qos.QoSReliabilityPolicy is ReliabilityPolicy
    assert qos.QoSDurabilityPolicy is DurabilityPolicy
    assert qos.QoSHistoryPolicy is HistoryPolicy
    assert qos.QoSLivelinessPolicy is LivelinessPolicy
    assert ReliabilityPolicy.RMW_QOS_POLICY_RELIABILITY_RELIABLE is ReliabilityPolicy.RELIABLE
    assert DurabilityPolicy.RMW_QOS_POLICY_DURABILITY_VOLATILE.name == "VOLATILE"


def test_short_keys() -> None:
    assert ReliabilityPolicy.short_keys() == [
        "system_default",
        "reliable",
        "best_effort",
        "unknown",
        "best_available",
    ]
    assert ReliabilityPolicy.get_from_short_key("Best_Effort") == 2
    assert LivelinessPolicy.MANUAL_BY_TOPIC.short_key == "manual_by_topic"
    with pytest.raises(KeyError):
        HistoryPolicy.get_from_short_key("some")
    assert QoSPresetProfiles.get_from_short_key("sensor_data") is qos.qos_profile_sensor_data
    assert "parameter_events" in QoSPresetProfiles.short_keys()


@for_each(
    "name",
    [
        "default",
        "system_default",
        "sensor_data",
        "services_default",
        "parameters",
        "parameter_events",
        "rosout_default",
        "action_status_default",
    ],
)
def test_presets_are_those_of_the_bus(name: str) -> None:
    assert to_native(QoSPresetProfiles.get_from_short_key(name)) == native.PRESETS[name]


def test_best_available_matches_every_peer() -> None:
    best = qos.qos_profile_best_available
    offered, requested = to_native(best, for_publisher=True), to_native(best)
    demanding = native.QoSProfile(durability="transient_local", liveliness="manual_by_topic")
    modest = native.QoSProfile(reliability="best_effort")
    assert not native.check_compatible(offered, demanding)
    assert not native.check_compatible(modest, requested)
    assert requested.deadline is requested.liveliness_lease_duration is None
    assert requested.durability is native.Durability.BEST_AVAILABLE
    both = to_native(best, for_both=True)
    assert not native.check_compatible(both, both)
    assert both.durability is native.Durability.VOLATILE


def test_unknown_is_no_choice() -> None:
    with pytest.raises(InvalidQoSProfileException, match="UNKNOWN"):
        to_native(qos.qos_profile_unknown)


def test_ints_and_other_things() -> None:
    assert to_native(7) == native.QoSProfile(depth=7)
    profile = QoSProfile(depth=1)
    assert profile_of(profile) is profile
    with pytest.raises(ValueError, match="depth must be greater than or equal to zero"):
        profile_of(-1)
    with pytest.raises(TypeError, match="Expected QoSProfile or int, but received <class 'str'>"):
        profile_of("10")  # type: ignore[arg-type]


def test_what_the_graph_knows() -> None:
    known = native.QoSProfile(depth=4, reliability="best_effort", deadline=0.25)
    shown = from_native(known)
    assert (shown.depth, shown.reliability) == (4, ReliabilityPolicy.BEST_EFFORT)
    assert (shown.deadline, shown.lifespan) == (Duration(seconds=0.25), Infinite)
    assert to_native(shown) == known


def test_compatibility() -> None:
    automatic = QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC)
    assert qos_check_compatible(automatic, automatic) == (QoSCompatibility.OK, "")
    verdict, reason = qos_check_compatible(qos.qos_profile_sensor_data, QoSProfile(depth=1))
    assert verdict is QoSCompatibility.ERROR
    assert reason == "ERROR: Best effort publisher and reliable subscription;"


OPEN_POLICIES: tuple[tuple[dict[str, Any], dict[str, Any], str], ...] = (
    ({}, {}, "Publisher liveliness is system_default and subscription liveliness is system_default"),
    ({"liveliness": 1}, {}, "Publisher's liveliness is automatic, but subscription's is system_default"),
    ({}, {"liveliness": 1}, ""),
    ({"liveliness": 3}, {}, ""),
    (
        {},
        {"liveliness": 3},
        "Subscription's liveliness is manual by topic, but publisher's is system_default",
    ),
    ({"liveliness": 1, "reliability": 0}, {"liveliness": 1, "reliability": 2}, ""),
    (
        {"liveliness": 1, "reliability": 3},
        {"liveliness": 1, "reliability": 1},
        "Reliable subscription, but publisher is unknown",
    ),
    (
        {"liveliness": 1, "durability": 2},
        {"liveliness": 1, "durability": 0},
        "Volatile publisher, but subscription is system_default",
    ),
    ({"liveliness": 1, "durability": 1}, {"liveliness": 1, "durability": 0}, ""),
)
"""A publisher's policies, a subscription's, and the warning of genuine rclpy."""


@for_each("row", OPEN_POLICIES)
def test_policies_left_open_are_warnings(row: tuple[dict[str, Any], dict[str, Any], str]) -> None:
    offered, requested, text = row
    verdict, reason = qos_check_compatible(QoSProfile(depth=1, **offered), QoSProfile(depth=1, **requested))
    assert reason == (f"WARNING: {text};" if text else "")
    assert verdict is (QoSCompatibility.WARNING if text else QoSCompatibility.OK)


def test_several_warnings_and_an_error_in_place_of_warnings() -> None:
    verdict, reason = qos_check_compatible(qos.qos_profile_system_default, QoSProfile(depth=1))
    assert verdict is QoSCompatibility.WARNING
    assert reason.count("WARNING: ") == 2
    verdict, reason = qos_check_compatible(qos.qos_profile_unknown, qos.qos_profile_unknown)
    assert verdict is QoSCompatibility.WARNING and reason.count(" unknown") == 6
    verdict, reason = qos_check_compatible(
        QoSProfile(depth=1), QoSProfile(depth=1, deadline=Duration(seconds=1))
    )
    assert verdict is QoSCompatibility.ERROR and "WARNING" not in reason


def test_names_of_policies() -> None:
    assert qos_policy_name_from_kind(16) == "RELIABILITY"
    assert {kind.name: int(kind) for kind in native.Policy}.items() <= {
        kind.name: int(kind) for kind in QoSPolicyKind
    }.items()

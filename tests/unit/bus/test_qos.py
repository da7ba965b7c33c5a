"""QoS profiles: accepted values, the encoding, and the matrix of compatibility."""

import itertools
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import qos
from bus.errors import ConfigurationError
from bus.qos import Durability, History, Liveliness, Policy, QoSProfile, Reliability
from rows import for_each

BEST_EFFORT = "ERROR: Best effort publisher and reliable subscription;"
VOLATILE = "ERROR: Volatile publisher and transient local subscription;"
NO_DEADLINE = "ERROR: Subscription has a deadline, but publisher does not;"
DEADLINE_LESS = "ERROR: Subscription deadline is less than publisher deadline;"
AUTOMATIC = "ERROR: Publisher's liveliness is automatic and subscription's is manual by topic;"
NO_LEASE = "ERROR: Subscription has a liveliness lease duration, but publisher does not;"
LEASE_LESS = "ERROR: Subscription liveliness lease duration is less than publisher;"

# (offered, requested) -> the reason. All other pairs match.
REFUSED_RELIABILITY = {("best_effort", "reliable"): BEST_EFFORT}
REFUSED_DURABILITY = {("volatile", "transient_local"): VOLATILE}
REFUSED_LIVELINESS = {("automatic", "manual_by_topic"): AUTOMATIC}
REFUSED_DEADLINE: dict[tuple[float | None, float | None], str] = {
    (None, 0.5): NO_DEADLINE,
    (None, 1.0): NO_DEADLINE,
    (None, 2.0): NO_DEADLINE,
    (1.0, 0.5): DEADLINE_LESS,
    (2.0, 0.5): DEADLINE_LESS,
    (2.0, 1.0): DEADLINE_LESS,
}
REFUSED_LEASE = {
    pair: NO_LEASE if text == NO_DEADLINE else LEASE_LESS for pair, text in REFUSED_DEADLINE.items()
}
DURATIONS = (None, 0.5, 1.0, 2.0)


def every_profile() -> list[QoSProfile]:
    return [
        QoSProfile(
            reliability=reliability,
            durability=durability,
            deadline=deadline,
            liveliness=liveliness,
            liveliness_lease_duration=lease,
        )
        for reliability, durability, deadline, liveliness, lease in itertools.product(
            Reliability, Durability, DURATIONS, Liveliness, DURATIONS
        )
    ]


def test_compatibility_of_every_pair() -> None:
    for offered, requested in itertools.product(every_profile(), repeat=2):
        expected = [
            text
            for text in (
                REFUSED_RELIABILITY.get((offered.reliability.value, requested.reliability.value)),
                REFUSED_DURABILITY.get((offered.durability.value, requested.durability.value)),
                REFUSED_DEADLINE.get((offered.deadline, requested.deadline)),
                REFUSED_LIVELINESS.get((offered.liveliness.value, requested.liveliness.value)),
                REFUSED_LEASE.get(
                    (offered.liveliness_lease_duration, requested.liveliness_lease_duration),
                ),
            )
            if text is not None
        ]
        found = qos.check_compatible(offered, requested)
        assert [reason.text for reason in found] == expected, (offered, requested)
        assert qos.describe_incompatibilities(found) == "".join(expected)


@for_each(
    ("offered", "requested", "policy"),
    [
        (QoSProfile(reliability="best_effort"), QoSProfile(), Policy.RELIABILITY),
        (QoSProfile(), QoSProfile(durability="transient_local"), Policy.DURABILITY),
        (QoSProfile(), QoSProfile(deadline=1), Policy.DEADLINE),
        (QoSProfile(deadline=2), QoSProfile(deadline=1), Policy.DEADLINE),
        (QoSProfile(), QoSProfile(liveliness="manual_by_topic"), Policy.LIVELINESS),
        (QoSProfile(), QoSProfile(liveliness_lease_duration=1), Policy.LIVELINESS_LEASE_DURATION),
        (
            QoSProfile(liveliness_lease_duration=2),
            QoSProfile(liveliness_lease_duration=1),
            Policy.LIVELINESS_LEASE_DURATION,
        ),
    ],
)
def test_each_reason_names_its_policy(offered: QoSProfile, requested: QoSProfile, policy: Policy) -> None:
    assert [reason.policy for reason in qos.check_compatible(offered, requested)] == [policy]


@for_each("depth", [1, 1000])
@for_each("history", list(History))
@for_each("lifespan", [None, 1.0])
def test_history_depth_and_lifespan_never_block(depth: int, history: History, lifespan: float | None) -> None:
    other = QoSProfile(depth=depth, history=history, lifespan=lifespan)
    assert qos.check_compatible(QoSProfile(), other) == []
    assert qos.check_compatible(other, QoSProfile()) == []


def test_policy_numbers_are_rclpys() -> None:
    assert {policy.name: policy.value for policy in Policy} == {
        "DURABILITY": 2,
        "DEADLINE": 4,
        "LIVELINESS": 8,
        "RELIABILITY": 16,
        "LIVELINESS_LEASE_DURATION": 256,
    }


def test_defaults_are_ros_2s() -> None:
    profile = QoSProfile()
    assert profile.depth == 10
    assert profile.history is History.KEEP_LAST
    assert profile.reliability is Reliability.RELIABLE
    assert profile.durability is Durability.VOLATILE
    assert profile.liveliness is Liveliness.AUTOMATIC
    assert (profile.deadline, profile.lifespan, profile.liveliness_lease_duration) == (None, None, None)
    assert (profile.deadline_ns, profile.lifespan_ns, profile.lease_ns) == (0, 0, 0)


def test_enums_by_name_in_any_case() -> None:
    profile = QoSProfile(
        history="KEEP_ALL",
        reliability="Best_Effort",
        durability="transient_local",
        liveliness="MANUAL_BY_TOPIC",
    )
    assert profile.history is History.KEEP_ALL
    assert profile.reliability is Reliability.BEST_EFFORT
    assert profile.durability is Durability.TRANSIENT_LOCAL
    assert profile.liveliness is Liveliness.MANUAL_BY_TOPIC
    assert profile == QoSProfile(
        history=History.KEEP_ALL,
        reliability=Reliability.BEST_EFFORT,
        durability=Durability.TRANSIENT_LOCAL,
        liveliness=Liveliness.MANUAL_BY_TOPIC,
    )


def test_durations_in_seconds() -> None:
    profile = QoSProfile(deadline=1, lifespan=0.25, liveliness_lease_duration=1e-9)
    assert (profile.deadline_ns, profile.lifespan_ns, profile.lease_ns) == (10**9, 250_000_000, 1)
    assert type(profile.deadline) is float
    assert QoSProfile(deadline=math.inf) == QoSProfile()


def test_unknown_name_says_the_nearest() -> None:
    with pytest.raises(ConfigurationError) as caught:
        QoSProfile(reliability="best-efort")
    assert str(caught.value) == (
        "unknown QoS reliability 'best-efort'; did you mean 'best_effort'? (allowed: reliable, best_effort)"
    )
    with pytest.raises(
        ConfigurationError, match=r"^unknown QoS history '\?' \(allowed: keep_last, keep_all\)$"
    ):
        QoSProfile(history="?")


@for_each(
    ("fields", "text"),
    [
        ({"depth": 0}, "depth must be from 1 to 2147483647, not 0"),
        ({"depth": -1, "history": "keep_all"}, "depth must be from 0 to 2147483647, not -1"),
        ({"depth": 2**31}, "not 2147483648"),
        ({"depth": True}, "depth must be an int, not bool True"),
        ({"depth": 1.0}, "depth must be an int, not float 1.0"),
        ({"depth": "10"}, "depth must be an int, not str '10'"),
        ({"deadline": 0}, "deadline must be above zero"),
        ({"deadline": 1e-10}, "deadline must be above zero"),
        ({"lifespan": -1.0}, "lifespan must be above zero"),
        ({"lifespan": math.nan}, "lifespan must be above zero"),
        ({"lifespan": 1e10}, "at most 9223372036854775807 nanoseconds, not 10000000000.0 seconds"),
        ({"liveliness_lease_duration": "1"}, "liveliness_lease_duration must be seconds"),
        ({"liveliness_lease_duration": True}, "liveliness_lease_duration must be seconds"),
        ({"history": 1}, "QoS history must be a name, not int 1"),
    ],
)
def test_refused(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        QoSProfile(**fields)
    assert text in str(caught.value)


def test_depth_does_not_matter_under_keep_all() -> None:
    assert QoSProfile(depth=0, history="keep_all").history is History.KEEP_ALL


def test_frozen() -> None:
    with pytest.raises(AttributeError):
        QoSProfile().depth = 3  # type: ignore[misc]


durations = st.none() | st.floats(1e-9, 9e9)
profiles = st.builds(
    QoSProfile,
    depth=st.integers(1, qos.MAX_DEPTH),
    history=st.sampled_from(History),
    reliability=st.sampled_from(Reliability),
    durability=st.sampled_from(Durability),
    deadline=durations,
    lifespan=durations,
    liveliness=st.sampled_from(Liveliness),
    liveliness_lease_duration=durations,
)


@given(profiles)
def test_travels_unchanged(profile: QoSProfile) -> None:
    decoded = msgspec.msgpack.decode(msgspec.msgpack.encode(profile), type=QoSProfile)
    assert decoded == profile
    assert type(decoded.reliability) is Reliability


@given(profiles, profiles)
def test_a_publisher_serves_its_own_request_and_reasons_do_not_repeat(
    one: QoSProfile, other: QoSProfile
) -> None:
    assert qos.check_compatible(one, one) == []
    policies = [reason.policy for reason in qos.check_compatible(one, other)]
    assert len(policies) == len(set(policies))


def test_defaults_take_no_bytes() -> None:
    assert msgspec.msgpack.encode(QoSProfile()) == msgspec.msgpack.encode({})
    assert msgspec.to_builtins(qos.sensor_data) == {"depth": 5, "reliability": "best_effort"}


@for_each(
    "fields",
    [
        {"depth": 0},
        {"depth": "10"},
        {"depth": None},
        {"reliability": "relable"},
        {"deadline": -1},
        {"lifespan": "1"},
    ],
)
def test_decoding_refuses_bad_values(fields: dict[str, object]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.msgpack.decode(msgspec.msgpack.encode(fields), type=QoSProfile)


def test_decoding_skips_fields_of_a_newer_protocol() -> None:
    later = msgspec.msgpack.encode({"depth": 3, "priority": 7})
    assert msgspec.msgpack.decode(later, type=QoSProfile) == QoSProfile(depth=3)


def test_what_stands_for_a_profile() -> None:
    assert qos.profile(7) == QoSProfile(depth=7)
    assert qos.profile("sensor_data") is qos.sensor_data
    assert qos.profile("SENSOR_DATA") is qos.sensor_data
    own = QoSProfile(deadline=1)
    assert qos.profile(own) is own


@for_each(
    ("value", "text"),
    [
        (0, "QoS depth must be from 1"),
        (True, "QoS must be a depth (int), a QoSProfile or the name of a preset, not bool True"),
        (1.5, "not float 1.5"),
        (None, "not NoneType None"),
        ("sensordata", "unknown QoS preset 'sensordata'; did you mean 'sensor_data'?"),
    ],
)
def test_what_does_not_stand_for_a_profile(value: Any, text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        qos.profile(value)
    assert text in str(caught.value)


def test_presets() -> None:
    assert qos.default == qos.system_default == qos.services_default == QoSProfile()
    assert qos.sensor_data == QoSProfile(depth=5, reliability="best_effort")
    assert qos.parameters == qos.parameter_events == QoSProfile(depth=1000)
    assert qos.rosout_default == QoSProfile(depth=1000, durability="transient_local", lifespan=10)
    assert qos.action_status_default == QoSProfile(depth=1, durability="transient_local")
    assert all(getattr(qos, name) is preset for name, preset in qos.PRESETS.items())


def test_lines_of_topic_info() -> None:
    assert qos.describe_profile(QoSProfile()) == [
        "QoS profile:",
        "  Reliability: RELIABLE",
        "  History (Depth): KEEP_LAST (10)",
        "  Durability: VOLATILE",
        "  Lifespan: Infinite",
        "  Deadline: Infinite",
        "  Liveliness: AUTOMATIC",
        "  Liveliness lease duration: Infinite",
    ]
    other = QoSProfile(
        history="keep_all",
        reliability="best_effort",
        durability="transient_local",
        lifespan=1.5,
        deadline=0.1,
        liveliness="manual_by_topic",
        liveliness_lease_duration=2,
    )
    assert qos.describe_profile(other) == [
        "QoS profile:",
        "  Reliability: BEST_EFFORT",
        "  History (Depth): KEEP_ALL",
        "  Durability: TRANSIENT_LOCAL",
        "  Lifespan: 1500000000 nanoseconds",
        "  Deadline: 100000000 nanoseconds",
        "  Liveliness: MANUAL_BY_TOPIC",
        "  Liveliness lease duration: 2000000000 nanoseconds",
    ]


def test_lossless_is_reliable_and_keeps_all() -> None:
    kinds = itertools.product(History, Reliability)
    lossless = [(one, two) for one, two in kinds if QoSProfile(history=one, reliability=two).is_lossless]
    assert lossless == [(History.KEEP_ALL, Reliability.RELIABLE)]


def test_a_depth_stands_for_one_profile() -> None:
    class Seven:
        __hash__ = None  # type: ignore[assignment]

        def __index__(self) -> int:
            return 7

    seven: Any = Seven()
    assert qos.profile(7) is qos.profile(7) is qos.profile(seven)
    assert qos.profile(7) == QoSProfile(7)

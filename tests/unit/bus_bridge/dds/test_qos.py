from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.qos import PRESETS, Durability, History, Liveliness, QoSProfile, Reliability
from bus_bridge.dds.qos import (
    ReaderKind,
    kinds_for,
    of_publisher,
    of_subscription,
    profile_of,
    strength,
)
from bus_bridge.rtps.policies import MANUAL_BY_TOPIC, TRANSIENT_LOCAL, Policies
from rows import for_each

_BEST_EFFORT = QoSProfile(5, reliability=Reliability.BEST_EFFORT)
_LATCHED = QoSProfile(3, durability=Durability.TRANSIENT_LOCAL)
_LOSSLESS = QoSProfile(history=History.KEEP_ALL)
_TIMED = QoSProfile(deadline=0.5, lifespan=2.0, liveliness_lease_duration=1.5)
_TIMES: dict[str, Any] = {"deadline_ns": 500_000_000, "lease_ns": 1_500_000_000}


@for_each(
    "profile, offered",
    [
        (QoSProfile(10), Policies(depth=1000)),
        (QoSProfile(5000), Policies(depth=5000)),
        (_BEST_EFFORT, Policies(reliable=False, depth=1000)),
        (_LATCHED, Policies(durability=TRANSIENT_LOCAL, depth=3)),
        (_LOSSLESS, Policies(keep_all=True, depth=1000)),
        (_TIMED, Policies(depth=1000, lifespan_ns=2_000_000_000, **_TIMES)),
        (QoSProfile(liveliness=Liveliness.MANUAL_BY_TOPIC), Policies(depth=1000)),
    ],
)
def test_what_a_publisher_offers(profile: QoSProfile, offered: Policies) -> None:
    assert of_publisher(profile, 1000) == offered


_BEST = QoSProfile(durability=Durability.BEST_AVAILABLE)
_ECHO = QoSProfile(reliability=Reliability.BEST_EFFORT, durability=Durability.BEST_AVAILABLE)
_PLAIN, _PLAIN_BE, _KEPT, _KEPT_BE = (
    ReaderKind(kept, reliable) for kept in (False, True) for reliable in (True, False)
)


@for_each(
    "profile, far, kinds",
    [
        (QoSProfile(), [], {_PLAIN}),
        (QoSProfile(), [_KEPT, _PLAIN_BE], {_PLAIN}),
        (_BEST_EFFORT, [_KEPT], {_PLAIN_BE}),
        (_LATCHED, [], {_KEPT}),
        (_LATCHED, [_PLAIN, _KEPT_BE], {_KEPT}),
        (_BEST, [], {_PLAIN}),
        (_BEST, [_KEPT, _KEPT], {_KEPT}),
        (_BEST, [_KEPT, _PLAIN], {_KEPT, _PLAIN}),
        (_ECHO, [], {_PLAIN_BE}),
        (_ECHO, [_PLAIN], {_PLAIN_BE}),
        (_ECHO, [_KEPT, _PLAIN], {_KEPT, _PLAIN_BE}),
        (_ECHO, [_KEPT_BE, _KEPT], {_KEPT, _KEPT_BE}),
    ],
)
def test_which_readers_a_subscription_needs(
    profile: QoSProfile, far: list[ReaderKind], kinds: set[ReaderKind]
) -> None:
    assert kinds_for(profile, far) == kinds


@for_each(
    "profile, kind, requested",
    [
        (QoSProfile(10), _PLAIN, Policies(depth=1000)),
        (_BEST_EFFORT, _PLAIN_BE, Policies(reliable=False, depth=1000)),
        (_LATCHED, _KEPT, Policies(durability=TRANSIENT_LOCAL, depth=1000)),
        (_LOSSLESS, _PLAIN, Policies(keep_all=True, depth=1000)),
        (
            QoSProfile(history=History.KEEP_ALL, reliability=Reliability.BEST_EFFORT),
            _PLAIN_BE,
            Policies(False, depth=1000),
        ),
        (_TIMED, _PLAIN, Policies(depth=1000, **_TIMES)),
        (
            QoSProfile(liveliness=Liveliness.MANUAL_BY_TOPIC),
            _PLAIN,
            Policies(depth=1000, liveliness=MANUAL_BY_TOPIC),
        ),
    ],
)
def test_what_a_reader_requests(profile: QoSProfile, kind: ReaderKind, requested: Policies) -> None:
    assert of_subscription(profile, 1000, kind) == requested


@for_each(
    "policies, profile",
    [
        (Policies(), QoSProfile(10)),  # without a depth
        (Policies(depth=7), QoSProfile(7)),
        (Policies(keep_all=True), QoSProfile(0, history=History.KEEP_ALL)),
        (
            Policies(reliable=False, durability=TRANSIENT_LOCAL),
            QoSProfile(10, reliability=Reliability.BEST_EFFORT, durability=Durability.TRANSIENT_LOCAL),
        ),
        (Policies(lifespan_ns=2_000_000_000, **_TIMES), _TIMED),
        (Policies(liveliness=MANUAL_BY_TOPIC), QoSProfile(liveliness=Liveliness.MANUAL_BY_TOPIC)),
    ],
)
def test_the_profile_of_a_far_endpoint(policies: Policies, profile: QoSProfile) -> None:
    assert profile_of(policies) == profile


def test_presets_come_back_as_they_were() -> None:
    for profile in PRESETS.values():
        if profile.durability is not Durability.BEST_AVAILABLE and profile.depth > 1:
            assert profile_of(of_publisher(profile, 1)) == profile


def test_a_duration_of_nothing_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="its lease is 0 nanoseconds"):
        profile_of(Policies(lease_ns=0))


def test_the_strongest_reader_gets_most() -> None:
    ranked = [
        Policies(reliable=False, depth=5),
        Policies(reliable=True, depth=1),
        Policies(reliable=True, keep_all=True),
        Policies(reliable=False, durability=TRANSIENT_LOCAL),
        Policies(reliable=True, durability=TRANSIENT_LOCAL),
    ]
    assert sorted([*ranked[2:], *ranked[:2]], key=strength) == ranked

"""The QoS with which the rules show endpoints on the other side."""

from bus.qos import QoSProfile
from bus_bridge.core.qos_rule import AS_IT_IS, QosRule
from bus_bridge.core.rules import Rules, TopicRule
from rows import for_each

BEST = QoSProfile(5, reliability="best_effort")
KEPT = QoSProfile(3, durability="transient_local", deadline=1.5, lifespan=2.5)
LOSSLESS = QoSProfile(history="keep_all")


@for_each(
    ("rule", "before", "after"),
    [
        (AS_IT_IS, KEPT, KEPT),
        (QosRule(reliability="reliable"), BEST, QoSProfile(5)),
        (
            QosRule(reliability="best_effort", depth=7),
            KEPT,
            QoSProfile(
                7, reliability="best_effort", durability="transient_local", deadline=1.5, lifespan=2.5
            ),
        ),
        (QosRule(durability="volatile"), KEPT, QoSProfile(3, deadline=1.5, lifespan=2.5)),
        (
            QosRule(durability="transient_local"),
            BEST,
            QoSProfile(5, reliability="best_effort", durability="transient_local"),
        ),
        (QosRule(depth=2), LOSSLESS, QoSProfile(2)),
        (QosRule(reliability="reliable"), LOSSLESS, LOSSLESS),
        (
            QosRule(reliability="reliable"),
            QoSProfile(history="keep_all", reliability="best_effort"),
            QoSProfile(1000),
        ),
    ],
)
def test_profiles(rule: QosRule, before: QoSProfile, after: QoSProfile) -> None:
    assert rule.applied(before) == after
    assert before.is_lossless or not rule.applied(before).is_lossless


def test_the_last_rule_that_has_the_key_counts() -> None:
    rules = Rules(
        topics=[
            TopicRule(pattern="/**", publisher=QosRule(reliability="best_effort", depth=1)),
            TopicRule(pattern="/scan", publisher=QosRule(depth=9), subscription=QosRule(depth=2)),
        ]
    )
    scan, other = rules.crossing("/scan"), rules.crossing("/other")
    assert scan.qos_of("publisher", KEPT).depth == 9
    assert scan.qos_of("publisher", KEPT).reliability == "best_effort"
    assert scan.qos_of("subscription", KEPT) == QoSProfile(
        2, durability="transient_local", deadline=1.5, lifespan=2.5
    )
    assert other.qos_of("publisher", BEST) == QoSProfile(1, reliability="best_effort")
    assert other.qos_of("subscription", BEST) == BEST
    for part in ("/add/_request", "/fibonacci/_action/status"):  # services and actions need their own QoS
        assert rules.crossing(part).qos_of("publisher", KEPT) == KEPT

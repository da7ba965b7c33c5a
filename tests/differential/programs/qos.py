"""QoS profiles: defaults, comparison, errors, C profiles, and compatible pairs."""

import warnings

import rclpy.qos
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import _get_allowed_policies, _get_qos_policy_parameter
from rclpy.subscription import Subscription
from show import attempt

warnings.simplefilter("error")
for name, profile in (
    ("depth", QoSProfile(depth=5)),
    ("all", QoSProfile(history=HistoryPolicy.KEEP_ALL)),
    (
        "best effort",
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, deadline=Duration(seconds=1)),
    ),
):
    print(name, profile)
    given = profile.get_c_qos_profile().to_dict()
    print({key: str(value) for key, value in sorted(given.items())})
    print(QoSProfile(**given) == profile, QoSProfile(**given) is profile)
for preset in QoSPresetProfiles:
    if preset.name != "ROSOUT_DEFAULT":
        print(preset.name, preset.value)
print(QoSPresetProfiles.get_from_short_key("sensor_data") is rclpy.qos.qos_profile_sensor_data)
for policy in (HistoryPolicy, ReliabilityPolicy, DurabilityPolicy, LivelinessPolicy):
    print(policy.__name__, policy.short_keys(), [one.short_key for one in policy])
print(ReliabilityPolicy.get_from_short_key("best_effort"))
attempt("short key", ReliabilityPolicy.get_from_short_key, "worst")
attempt("nothing", QoSProfile)
attempt("no depth", QoSProfile, history=HistoryPolicy.KEEP_LAST)
attempt("depth 0", QoSProfile, depth=0)
attempt("unknown", QoSProfile, depth=1, colour=1)
attempt("history", QoSProfile, depth=1, history=99)
attempt("reliability", QoSProfile, depth=1, reliability="reliable")
attempt("deadline", QoSProfile, depth=1, deadline=1.0)
profile = QoSProfile(depth=1)
attempt("set", setattr, profile, "durability", "volatile")
attempt("set", setattr, profile, "depth", "3")
profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
print(
    profile == QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    profile == QoSProfile(depth=1),
)
print([name.name for name in _get_allowed_policies(Subscription)])
for kind in rclpy.qos.QoSPolicyKind:
    attempt(f"parameter {kind.name}", _get_qos_policy_parameter, profile, kind)
    attempt(f"name {kind.name}", qos_policy_name_from_kind, kind)
publishers = {
    "default": QoSProfile(depth=1),
    "best effort": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    "late": QoSProfile(depth=1, deadline=Duration(seconds=2)),
    "system": QoSPresetProfiles.SYSTEM_DEFAULT.value,
}
subscriptions = {
    "default": QoSProfile(depth=1),
    "transient": QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    "early": QoSProfile(depth=1, deadline=Duration(seconds=1)),
    "manual": QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC),
    "sensor": QoSPresetProfiles.SENSOR_DATA.value,
}
for one, offered in publishers.items():
    for other, wanted in subscriptions.items():
        compatible, reason = qos_check_compatible(offered, wanted)
        print(one, other, compatible.name, reason)

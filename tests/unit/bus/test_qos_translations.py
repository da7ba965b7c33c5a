"""Every policy of a QoS profile keeps its value in every other form of profiles."""

from typing import Any

import msgspec
import pytest

from bus.qos import CHOICES, POLICIES, PolicyField, QoSProfile, default, in_words, info_lines
from bus_bag.profiles import overrides_from_yaml, profile_to_yaml, profiles_from_yaml
from bus_bridge.dds import qos as dds
from bus_bridge.zenoh import qos_text
from bus_ros.rclpy import qos as rclpy
from rows import for_each


def changed(policy: PolicyField) -> QoSProfile:
    """The default profile with another value of `policy`. A publisher can offer it."""
    default_value = getattr(default, policy.name)
    value = next((one for one in policy.offers.values() if one is not default_value), 1.5)
    fields: dict[str, Any] = {policy.name: value}
    return QoSProfile(**fields)


def value_in(policy: PolicyField, profile: QoSProfile) -> object:
    return getattr(profile, policy.name)


def test_every_field_is_a_policy() -> None:
    fields = [field.name for field in msgspec.structs.fields(QoSProfile)]
    assert sorted(fields) == sorted(["depth", *(policy.name for policy in POLICIES)])
    assert all(set(policy.offers.values()) <= set(policy.kind or ()) for policy in CHOICES)


@for_each("policy", POLICIES)
def test_the_wire(policy: PolicyField) -> None:
    frame = msgspec.msgpack.encode(changed(policy))
    assert msgspec.msgpack.decode(frame, type=QoSProfile) == changed(policy) != default


@for_each("policy", POLICIES)
def test_bags(policy: PolicyField) -> None:
    document = profile_to_yaml(changed(policy))
    (read,) = profiles_from_yaml([document])
    assert value_in(policy, read) == value_in(policy, changed(policy))
    (override,) = overrides_from_yaml({"/t": {policy.name: document[policy.name]}}).values()
    assert value_in(policy, override) == value_in(policy, changed(policy))


@for_each("policy", CHOICES)
def test_bags_with_numbers(policy: PolicyField) -> None:
    for number, value in policy.offers.items():
        (read,) = profiles_from_yaml([{policy.name: number}])
        assert value_in(policy, read) is value


@for_each("policy", POLICIES)
def test_keys_of_zenoh(policy: PolicyField) -> None:
    read = qos_text.read(qos_text.write(changed(policy)))
    assert read is not None and value_in(policy, read) == value_in(policy, changed(policy))


@for_each("policy", POLICIES)
def test_dds(policy: PolicyField) -> None:
    profile = changed(policy)
    kind = dds.ReaderKind(False, reliable=True)
    found = [
        dds.profile_of(dds.of_publisher(profile, 1)),
        dds.profile_of(dds.of_subscription(profile, 1, kind)),
    ]
    assert value_in(policy, profile) in [value_in(policy, one) for one in found]


@for_each("policy", POLICIES)
@pytest.mark.parametrize("for_publisher", [False, True])
def test_rclpy(policy: PolicyField, for_publisher: bool) -> None:
    shown = rclpy.from_native(changed(policy))
    assert rclpy.to_native(shown, for_publisher=for_publisher) == changed(policy)


@for_each("policy", POLICIES)
def test_texts(policy: PolicyField) -> None:
    assert in_words(changed(policy)) != in_words(default)
    lines = info_lines({one.name: f"<{one.name}>" for one in POLICIES}, 10)
    assert f"  {policy.label}: <{policy.name}>" in lines

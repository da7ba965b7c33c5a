"""QoS profiles in YAML, of bags and of overrides."""

import pytest
import yaml

from bus.errors import ConfigurationError
from bus.qos import QoSProfile
from bus_bag.metadata import profiles_to_text
from bus_bag.profiles import overrides_from_yaml, profile_to_yaml, profiles_from_yaml
from rows import for_each

NUMBERS = """
- history: 1
  depth: 7
  reliability: 2
  durability: 1
  deadline: {sec: 1, nsec: 500000000}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 3
  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}
  avoid_ros_namespace_conventions: false
- {history: 2, depth: 0, reliability: 1, durability: 2}
- {history: 3, depth: 0, reliability: 3, durability: 0, liveliness: 0}
- {history: unknown, depth: 0, reliability: system_default, durability: best_available}
"""
PROFILES = (
    QoSProfile(
        7, reliability="best_effort", durability="transient_local", deadline=1.5, liveliness="manual_by_topic"
    ),
    QoSProfile(history="keep_all"),
    QoSProfile(),
    QoSProfile(),
)


def test_both_forms() -> None:
    assert profiles_from_yaml(NUMBERS) == PROFILES
    assert profiles_from_yaml(yaml.safe_load(NUMBERS)) == PROFILES
    assert profiles_from_yaml(profiles_to_text(PROFILES)) == PROFILES
    assert profiles_from_yaml([profile_to_yaml(one) for one in PROFILES]) == PROFILES
    assert profiles_from_yaml("") == profiles_from_yaml(None) == ()


@for_each("value", ["[1", "{a: 1}", "- 1", 5])
def test_no_profiles(value: object) -> None:
    with pytest.raises(ValueError, match="profile"):
        profiles_from_yaml(value)


def test_overrides() -> None:
    document = {
        "/scan": {"depth": 3, "reliability": "best_effort", "deadline": {"sec": 2, "nsec": 0}},
        "x": {},
    }
    assert overrides_from_yaml(document) == {
        "/scan": QoSProfile(3, reliability="best_effort", deadline=2.0),
        "/x": QoSProfile(),
    }
    assert overrides_from_yaml(None) == {}


@for_each(
    ("profile", "text"),
    [
        ({"color": "red"}, "Unexpected key `color` for QoS profile."),
        ({"depth": -1}, "`depth` may not be a negative value."),
        (
            {"deadline": {"sec": 1}},
            "Time overrides must include both seconds (sec) and nanoseconds (nsec).",
        ),
        ({"deadline": {"sec": -1, "nsec": 0}}, "Time duration may not be a negative value."),
        ({"reliability": "reliabel"}, "unknown QoS reliability 'reliabel'; did you mean 'reliable'?"),
        ({"depth": "many"}, "QoS depth must be an int"),
        (7, "QoS profile of topic '/scan' must be a map of policies"),
    ],
)
def test_refused_overrides(profile: object, text: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        overrides_from_yaml({"/scan": profile})
    assert str(refused.value).startswith(text)

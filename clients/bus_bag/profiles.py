"""QoS profiles as YAML: in the metadata of bags, and in files that override them. Pure.

Since version 9 of the metadata, policies are names, and the profiles a list. Up to version 8, policies are
numbers, and the list is a text of YAML inside the YAML. MCAP files have such a text in each channel, in
either form.
"""

from collections.abc import Mapping
from typing import Any

from bus.errors import ConfigurationError
from bus.qos import CHOICES, DURATIONS, MAX_DEPTH, POLICIES, History, QoSProfile
from bus_bag.topic_names import absolute
from bus_bag.yaml_text import load

__all__ = ["overrides_from_yaml", "profile_to_yaml", "profiles_from_yaml"]

_NS_PER_S = 1_000_000_000
_LONGEST_NS = 2**63 - 1
_INFINITE = {"sec": 9223372036, "nsec": 854775807}
_INFINITE_OF_FOXY = {(2147483647, 4294967295), (2147483647, 2147483647)}
_DURATIONS = [one.name for one in DURATIONS]
_NUMBERS: dict[str, Mapping[int, str]] = {one.name: one.offers for one in CHOICES}
"""Names of policies by number. A missing number (unknown, or system default) means the default."""
_IGNORED = "avoid_ros_namespace_conventions"


def profile_to_yaml(profile: QoSProfile) -> dict[str, object]:
    """A profile in the form of version 9, in its order of keys."""
    found: dict[str, object] = {}
    for policy in POLICIES:
        is_duration = policy.kind is None
        name = policy.name
        found[name] = _duration_to_yaml(policy.ns(profile)) if is_duration else str(getattr(profile, name))
        if name == "history":
            found["depth"] = profile.depth
    return found | {_IGNORED: False}


def _duration_to_yaml(duration_ns: int) -> dict[str, int]:
    if not duration_ns:
        return dict(_INFINITE)
    seconds, nanoseconds = divmod(duration_ns, _NS_PER_S)
    return {"sec": seconds, "nsec": nanoseconds}


def profiles_from_yaml(value: object) -> tuple[QoSProfile, ...]:
    """Read profiles in either form: a list, or a YAML text of a list. None and an empty text give no
    profiles.

    Unknown policies get their default, and so does the depth of an unknown history: most bags of ROS 2 have
    one.

    Raises ValueError if it is not a list of profiles.
    """
    if isinstance(value, str):
        try:
            value = load(value, has_aliases=False)
        except ValueError as error:
            raise ValueError(f"QoS profiles: {error}") from None
    if value is None:
        return ()
    if not isinstance(value, list):
        raise ValueError(f"QoS profiles must be a list, not {type(value).__name__}")
    return tuple(_profile_of_bag(one) for one in value)


def _profile_of_bag(value: object) -> QoSProfile:
    if not isinstance(value, dict):
        raise ValueError(f"a QoS profile must be a map, not {type(value).__name__}")
    fields: dict[str, Any] = {}
    for policy, numbers in _NUMBERS.items():
        given = value.get(policy)
        name = numbers.get(given) if isinstance(given, int) else given
        if name in numbers.values():
            fields[policy] = name
    depth = value.get("depth")
    if isinstance(depth, int) and 1 <= depth <= MAX_DEPTH and fields.get("history") == History.KEEP_LAST:
        fields["depth"] = depth
    for field in _DURATIONS:
        fields[field] = _seconds_of_bag(value.get(field))
    return QoSProfile(**fields)


def _seconds_of_bag(value: object) -> float | None:
    if not isinstance(value, dict):
        return None
    seconds, nanoseconds = value.get("sec"), value.get("nsec")
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        return None
    if (seconds, nanoseconds) in _INFINITE_OF_FOXY:
        return None
    duration_ns = seconds * _NS_PER_S + nanoseconds
    return duration_ns / _NS_PER_S if 0 < duration_ns < _LONGEST_NS - _NS_PER_S else None


def overrides_from_yaml(document: object) -> dict[str, QoSProfile]:
    """Read a parsed file of QoS overrides: topic -> profile. Missing policies get their default.

    Raises ConfigurationError, with ROS 2's text if it has one.
    """
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise ConfigurationError("QoS overrides must be a map of topics to profiles")
    profiles = {}
    for topic, profile in document.items():
        if not isinstance(profile, dict):
            raise ConfigurationError(f"QoS profile of topic '{topic}' must be a map of policies")
        profiles[absolute(str(topic))] = _override(profile)
    return profiles


def _override(profile: Mapping[object, object]) -> QoSProfile:
    fields: dict[str, Any] = {}
    for key, value in profile.items():
        if key in _DURATIONS:
            fields[str(key)] = _override_seconds(value)
        elif key in _NUMBERS:
            if value != "system_default":
                fields[str(key)] = value
        elif key in ("depth", _IGNORED):
            if isinstance(value, int) and value < 0:
                raise ConfigurationError(f"`{key}` may not be a negative value.")
            if key == "depth":
                fields["depth"] = value
        else:
            raise ConfigurationError(f"Unexpected key `{key}` for QoS profile.")
    if fields.get("history") == History.KEEP_ALL:
        fields.pop("depth", None)
    return QoSProfile(**fields)


def _override_seconds(value: object) -> float | None:
    if value is None or value == {}:
        return None
    if not isinstance(value, dict) or not {"sec", "nsec"} <= value.keys():
        raise ConfigurationError("Time overrides must include both seconds (sec) and nanoseconds (nsec).")
    seconds, nanoseconds = value["sec"], value["nsec"]
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        raise ConfigurationError(f"Time overrides must be whole numbers, not {seconds!r} and {nanoseconds!r}")
    if seconds < 0 or nanoseconds < 0:
        raise ConfigurationError("Time duration may not be a negative value.")
    return _seconds_of_bag(value)

"""QoS profiles: offers of publishers, requests of subscriptions, and the rule for a match.

Owns the policies, their defaults and presets (rmw/qos_profiles.h), and the rule of compatibility with its
texts (rmw_dds_common/qos.cpp). Must not know the implementation of a policy.

A profile is frozen and always valid: no code needs to check it again. It is sent in this form, without fields
that have their defaults.
"""

import operator
from collections.abc import Mapping
from enum import IntEnum, StrEnum
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import msgspec

from bus.errors import ConfigurationError

__all__ = [
    "CHOICES",
    "DURATIONS",
    "MAX_DEPTH",
    "POLICIES",
    "PRESETS",
    "Durability",
    "History",
    "Incompatibility",
    "Liveliness",
    "Policy",
    "PolicyField",
    "QoS",
    "QoSProfile",
    "Reliability",
    "action_status_default",
    "check_compatible",
    "check_offer",
    "default",
    "describe_incompatibilities",
    "describe_profile",
    "in_words",
    "info_lines",
    "parameter_events",
    "parameters",
    "profile",
    "rosout_default",
    "sensor_data",
    "services_default",
    "system_default",
]

MAX_DEPTH = 2**31 - 1
_NS_PER_S = 1_000_000_000
_MAX_DURATION_NS = 2**63 - 1


class History(StrEnum):
    """How many samples an endpoint keeps.

    For example:

        bus.QoSProfile(history=bus.History.KEEP_ALL)
    """

    KEEP_LAST = "keep_last"
    """The last `depth` samples."""
    KEEP_ALL = "keep_all"
    """All samples, within the endpoint's quota."""


class Reliability(StrEnum):
    """Whether a sample may be lost on the way to the subscription's queue.

    For example:

        bus.QoSProfile(reliability=bus.Reliability.BEST_EFFORT)
    """

    RELIABLE = "reliable"
    """A sample may not be lost."""
    BEST_EFFORT = "best_effort"
    """A sample may be lost.

    A publisher with this policy does not match a subscription that requests reliable.
    """


class Durability(StrEnum):
    """Whether late joiners get the samples that the publisher still keeps.

    For example:

        bus.QoSProfile(1, durability=bus.Durability.TRANSIENT_LOCAL)
    """

    VOLATILE = "volatile"
    """Late joiners get no earlier samples."""
    TRANSIENT_LOCAL = "transient_local"
    """Late joiners get the kept samples, if both sides set this policy."""
    BEST_AVAILABLE = "best_available"
    """For subscriptions: they get kept samples from each publisher that keeps some, and match all others,
    too."""


class Liveliness(StrEnum):
    """How a publisher proves that it is alive.

    For example:

        bus.QoSProfile(liveliness=bus.Liveliness.MANUAL_BY_TOPIC, liveliness_lease_duration=1.0)
    """

    AUTOMATIC = "automatic"
    """By its running process."""
    MANUAL_BY_TOPIC = "manual_by_topic"
    """By publishing, or by calls of `assert_liveliness`."""


class Policy(IntEnum):
    """The policies that can prevent a match, with the numbers and names of rclpy's QoSPolicyKind."""

    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    LIVELINESS_LEASE_DURATION = 1 << 8


class PolicyField(msgspec.Struct, frozen=True):
    """One policy of a profile, with its names in other forms of profiles: texts, YAML, options, rmw."""

    name: str
    """Its field in QoSProfile. rclpy, rosbag2 and the options of tools use the same name."""
    label: str
    """Its name in `topic info -v`."""
    kind: type[StrEnum] | None = None
    """Its values; None for a duration."""
    offers: Mapping[int, StrEnum] = MappingProxyType({})
    """The values that a publisher may offer, by rmw's numbers."""
    word: str = ""
    """The word for a duration in short texts (`in_words`)."""
    letter: str = ""
    """The letter for a duration in the texts of bridges (`bus_bridge.zenoh.qos_text`)."""

    def ns(self, profile: "QoSProfile") -> int:
        """The duration in a profile, in nanoseconds; 0 if it is infinite."""
        return _nanoseconds(getattr(profile, self.name))


POLICIES = (
    PolicyField("history", "History (Depth)", History, {1: History.KEEP_LAST, 2: History.KEEP_ALL}),
    PolicyField(
        "reliability", "Reliability", Reliability, {1: Reliability.RELIABLE, 2: Reliability.BEST_EFFORT}
    ),
    PolicyField(
        "durability", "Durability", Durability, {1: Durability.TRANSIENT_LOCAL, 2: Durability.VOLATILE}
    ),
    PolicyField("deadline", "Deadline", word="deadline", letter="d"),
    PolicyField("lifespan", "Lifespan", word="lifespan", letter="l"),
    PolicyField(
        "liveliness", "Liveliness", Liveliness, {1: Liveliness.AUTOMATIC, 3: Liveliness.MANUAL_BY_TOPIC}
    ),
    PolicyField("liveliness_lease_duration", "Liveliness lease duration", word="lease", letter="e"),
)
"""All policies, in the order of rosbag2's YAML. The depth is a part of the history. The wire, texts, bags
and zenoh's texts are made from this table; docs/architecture.md names the places of the other forms."""
CHOICES = tuple(one for one in POLICIES if one.kind is not None)
DURATIONS = tuple(one for one in POLICIES if one.kind is None)

_Choice = TypeVar("_Choice", bound=StrEnum)


_KINDS = tuple((one.name, one.kind) for one in POLICIES if one.kind is not None)
_DURATION_NAMES = tuple(one.name for one in DURATIONS)


class QoSProfile(msgspec.Struct, frozen=True, omit_defaults=True):
    """The policies of one endpoint. Enums may be given by name, in any case.

    Durations are seconds, above zero; None (or infinity) means infinite. `depth` counts messages and is
    ignored under keep all.

    Raises ConfigurationError for an unknown name or a value out of range.

        qos = bus.QoSProfile(1, durability="transient_local")
    """

    depth: int = 10
    """How many samples are kept, from 1; under keep all from 0."""
    history: History = History.KEEP_LAST
    """Whether `depth` counts."""
    reliability: Reliability = Reliability.RELIABLE
    """Whether a sample may be lost on the way."""
    durability: Durability = Durability.VOLATILE
    """Whether late joiners get samples published before."""
    deadline: float | None = None
    """Longest expected gap between two samples."""
    lifespan: float | None = None
    """Age after which a sample is no longer delivered."""
    liveliness: Liveliness = Liveliness.AUTOMATIC
    """The publisher's way to prove that it is alive."""
    liveliness_lease_duration: float | None = None
    """Time without a sign of life after which the publisher counts as not alive."""

    if TYPE_CHECKING:

        def __init__(
            self,
            depth: int = 10,
            *,
            history: History | str = History.KEEP_LAST,
            reliability: Reliability | str = Reliability.RELIABLE,
            durability: Durability | str = Durability.VOLATILE,
            deadline: float | None = None,
            lifespan: float | None = None,
            liveliness: Liveliness | str = Liveliness.AUTOMATIC,
            liveliness_lease_duration: float | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        settle = msgspec.structs.force_setattr
        for field, kind in _KINDS:
            if (value := getattr(self, field)).__class__ is not kind:
                settle(self, field, _choice(kind, field, value))
        depth, least = self.depth, 0 if self.history is History.KEEP_ALL else 1
        if depth.__class__ is not int or not least <= depth <= MAX_DEPTH:
            settle(self, "depth", _depth(depth, least))
        for field in _DURATION_NAMES:
            if (seconds := getattr(self, field)) is not None:
                settle(self, field, _seconds(field, seconds))

    @property
    def is_lossless(self) -> bool:
        """Whether the profile is reliable and keep all, the only combination that makes a publisher wait."""
        return self.history is History.KEEP_ALL and self.reliability is Reliability.RELIABLE

    @property
    def deadline_ns(self) -> int:
        """`deadline` in nanoseconds; 0 if it is infinite."""
        return _nanoseconds(self.deadline)

    @property
    def lifespan_ns(self) -> int:
        """`lifespan` in nanoseconds; 0 if it is infinite."""
        return _nanoseconds(self.lifespan)

    @property
    def lease_ns(self) -> int:
        """`liveliness_lease_duration` in nanoseconds; 0 if it is infinite."""
        return _nanoseconds(self.liveliness_lease_duration)


QoS: TypeAlias = int | QoSProfile | str
"""A profile as users may pass it: a depth (of keep last), a profile, or a preset's name."""


def profile(value: QoS) -> QoSProfile:
    """The profile that `value` stands for: an int is keep last with that depth, a str the name of a preset.

    Raises ConfigurationError for anything else, and for a name that is no preset's.
    """
    if isinstance(value, QoSProfile):
        return value
    if isinstance(value, str):
        preset = PRESETS.get(value.lower())
        if preset is None:
            if value.strip().isdecimal():
                depth = value.strip()
                raise ConfigurationError(f"QoS {value!r} is a text: for a depth, write the int {depth}")
            raise ConfigurationError(_unknown("QoS preset", value, PRESETS))
        return preset
    if callable(value) and not isinstance(value, type):
        raise ConfigurationError(
            "a callback stands in the place of the QoS: the order is create_subscription(type, topic, QoS, "
            "callback), and create_service(type, name, callback, QoS)"
        )
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        kind = type(value).__name__
        raise ConfigurationError(
            f"QoS must be a depth (int), a QoSProfile or the name of a preset, not {kind} {value!r}"
        )
    return _keep_last(operator.index(value))


@lru_cache(64)
def _keep_last(depth: int) -> QoSProfile:
    return QoSProfile(depth)


class Incompatibility(msgspec.Struct, frozen=True):
    """One reason why a publisher and a subscription don't match, in ROS's words."""

    policy: Policy
    text: str


def check_compatible(offered: QoSProfile, requested: QoSProfile) -> list[Incompatibility]:
    """All reasons why `offered` can't serve `requested`; an empty list means a match."""
    found = []
    if (offered.reliability, requested.reliability) == (Reliability.BEST_EFFORT, Reliability.RELIABLE):
        found.append(_BEST_EFFORT)
    if (offered.durability, requested.durability) == (Durability.VOLATILE, Durability.TRANSIENT_LOCAL):
        found.append(_VOLATILE)
    if requested.deadline is not None:
        if offered.deadline is None:
            found.append(_NO_DEADLINE)
        elif requested.deadline_ns < offered.deadline_ns:
            found.append(_DEADLINE_LESS)
    if (offered.liveliness, requested.liveliness) == (Liveliness.AUTOMATIC, Liveliness.MANUAL_BY_TOPIC):
        found.append(_AUTOMATIC)
    if requested.liveliness_lease_duration is not None:
        if offered.liveliness_lease_duration is None:
            found.append(_NO_LEASE)
        elif requested.lease_ns < offered.lease_ns:
            found.append(_LEASE_LESS)
    return found


def check_offer(offered: QoSProfile) -> None:
    """Raise ConfigurationError for a policy that a publisher can't offer."""
    if offered.durability is Durability.BEST_AVAILABLE:
        raise ConfigurationError(
            "a publisher's QoS durability is volatile or transient_local; best_available is for subscriptions"
        )


def describe_incompatibilities(found: list[Incompatibility]) -> str:
    """All reasons as one text, joined as in rmw_dds_common."""
    return "".join(reason.text for reason in found)


def describe_profile(qos: QoSProfile) -> list[str]:
    """The lines of `QoS profile:` in `topic info -v`, in the format of rclpy's TopicEndpointInfo."""
    texts = {one.name: getattr(qos, one.name).name for one in CHOICES}
    texts |= {one.name: _duration_text(one.ns(qos)) for one in DURATIONS}
    return info_lines(texts, qos.depth)


def info_lines(texts: Mapping[str, str], depth: int) -> list[str]:
    """The same lines, from the text of each policy by its name."""
    lines = {one.name: f"  {one.label}: {texts[one.name]}" for one in POLICIES}
    if texts["history"] == History.KEEP_LAST.name:
        lines["history"] += f" ({depth})"
    first = [lines.pop(name) for name in ("reliability", "history", "durability", "lifespan")]
    return ["QoS profile:", *first, *lines.values()]


def in_words(qos: QoSProfile) -> str:
    """A profile in few words: history, reliability, and all other policies that differ from the default."""
    kept = "keep all" if qos.history is History.KEEP_ALL else f"keep last {qos.depth}"
    words = [kept, qos.reliability.replace("_", " ")]
    if qos.durability is not Durability.VOLATILE:
        words.append(qos.durability.replace("_", " "))
    if qos.liveliness is not Liveliness.AUTOMATIC:
        words.append("liveliness manual by topic")
    durations = [(one.word, getattr(qos, one.name)) for one in DURATIONS]
    words += [f"{word} {seconds:g} s" for word, seconds in durations if seconds is not None]
    return ", ".join(words)


_BEST_EFFORT = Incompatibility(Policy.RELIABILITY, "ERROR: Best effort publisher and reliable subscription;")
_VOLATILE = Incompatibility(Policy.DURABILITY, "ERROR: Volatile publisher and transient local subscription;")
_NO_DEADLINE = Incompatibility(Policy.DEADLINE, "ERROR: Subscription has a deadline, but publisher does not;")
_DEADLINE_LESS = Incompatibility(
    Policy.DEADLINE, "ERROR: Subscription deadline is less than publisher deadline;"
)
_AUTOMATIC = Incompatibility(
    Policy.LIVELINESS, "ERROR: Publisher's liveliness is automatic and subscription's is manual by topic;"
)
_NO_LEASE = Incompatibility(
    Policy.LIVELINESS_LEASE_DURATION,
    "ERROR: Subscription has a liveliness lease duration, but publisher does not;",
)
_LEASE_LESS = Incompatibility(
    Policy.LIVELINESS_LEASE_DURATION,
    "ERROR: Subscription liveliness lease duration is less than publisher;",
)


def _choice(kind: type[_Choice], field: str, value: str) -> _Choice:
    if isinstance(value, kind):
        return value
    if not isinstance(value, str):
        raise ConfigurationError(f"QoS {field} must be a name, not {type(value).__name__} {value!r}")
    try:
        return kind(value.lower())
    except ValueError:
        raise ConfigurationError(_unknown(f"QoS {field}", value, [member.value for member in kind])) from None


def _unknown(what: str, value: str, allowed: Mapping[str, object] | list[str]) -> str:
    from bus.base.suggest import did_you_mean

    hint = did_you_mean(value.lower(), allowed, 0.4)
    return f"unknown {what} '{value}'{hint} (allowed: {', '.join(allowed)})"


def _depth(value: int, least: int) -> int:
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise ConfigurationError(f"QoS depth must be an int, not {type(value).__name__} {value!r}")
    depth = operator.index(value)
    if not least <= depth <= MAX_DEPTH:
        raise ConfigurationError(f"QoS depth must be from {least} to {MAX_DEPTH}, not {depth}")
    return depth


def _seconds(field: str, value: float) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigurationError(
            f"QoS {field} must be seconds (float) or None, not {type(value).__name__} {value!r}"
        )
    if value == float("inf"):
        return None
    # Bounds in nanoseconds: a value that rounds to 0 would mean infinite. NaN fails both comparisons.
    if not 1 <= value * _NS_PER_S <= _MAX_DURATION_NS:
        raise ConfigurationError(
            f"QoS {field} must be above zero and at most {_MAX_DURATION_NS} nanoseconds, "
            f"not {value!r} seconds (None means infinite)"
        )
    return float(value)


def _nanoseconds(seconds: float | None) -> int:
    return 0 if seconds is None else round(seconds * _NS_PER_S)


def _duration_text(duration_ns: int) -> str:
    return f"{duration_ns} nanoseconds" if duration_ns else "Infinite"


default = QoSProfile()
system_default = default
sensor_data = QoSProfile(depth=5, reliability=Reliability.BEST_EFFORT)
services_default = QoSProfile()
parameters = QoSProfile(depth=1000)
parameter_events = QoSProfile(depth=1000)
rosout_default = QoSProfile(depth=1000, durability=Durability.TRANSIENT_LOCAL, lifespan=10.0)
action_status_default = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)

PRESETS: Mapping[str, QoSProfile] = MappingProxyType(
    {
        "default": default,
        "system_default": system_default,
        "sensor_data": sensor_data,
        "services_default": services_default,
        "parameters": parameters,
        "parameter_events": parameter_events,
        "rosout_default": rosout_default,
        "action_status_default": action_status_default,
    }
)

"""rclpy's QoS: mutable profiles, with "system default" and "best available" among the policies.

Owns the policies, the profiles, their presets, and their translation for the bus (`to_native`,
`from_native`). Must not know the effect of a policy: `bus.qos` and the library define it.
"""

import warnings
from collections.abc import Mapping
from copy import copy
from enum import Enum, IntEnum, StrEnum
from typing import Any, Generic, NamedTuple, TypeVar, overload

from bus import qos as native
from bus_ros.rclpy.duration import Duration, Infinite

__all__ = [
    "DurabilityPolicy",
    "HistoryPolicy",
    "InvalidQoSProfileException",
    "LivelinessPolicy",
    "QoSCompatibility",
    "QoSDurabilityPolicy",
    "QoSHistoryPolicy",
    "QoSLivelinessPolicy",
    "QoSPolicyEnum",
    "QoSPolicyKind",
    "QoSPresetProfiles",
    "QoSProfile",
    "QoSReliabilityPolicy",
    "ReliabilityPolicy",
    "from_native",
    "profile_of",
    "qos_check_compatible",
    "qos_policy_name_from_kind",
    "qos_profile_action_status_default",
    "qos_profile_best_available",
    "qos_profile_default",
    "qos_profile_parameter_events",
    "qos_profile_parameters",
    "qos_profile_rosout_default",
    "qos_profile_sensor_data",
    "qos_profile_services_default",
    "qos_profile_system_default",
    "qos_profile_unknown",
    "to_native",
]


class QoSPolicyKind(IntEnum):
    """Kinds of policies; each has a bit, as in rmw."""

    INVALID = 1 << 0
    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    HISTORY = 1 << 5
    LIFESPAN = 1 << 6
    DEPTH = 1 << 7
    LIVELINESS_LEASE_DURATION = 1 << 8
    AVOID_ROS_NAMESPACE_CONVENTIONS = 1 << 9


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """The policy's name, `RELIABILITY` for example; raises ValueError for an unknown number."""
    return QoSPolicyKind(policy_kind).name


class QoSPolicyEnum(IntEnum):
    """Base of the policies' enums. SYSTEM_DEFAULT leaves the choice to busd.

    Names that begin with RMW are for old programs.
    """

    @classmethod
    def short_keys(cls) -> list[str]:
        """The names for a command line: in lower case."""
        return [name.lower() for name in cls.__members__ if not name.startswith("RMW")]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """The number for a name in any case; raises KeyError."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        return self.name.lower()


class HistoryPolicy(QoSPolicyEnum):
    """The number of messages kept: the last `depth`, or all."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3
    RMW_QOS_POLICY_HISTORY_SYSTEM_DEFAULT = 0
    RMW_QOS_POLICY_HISTORY_KEEP_LAST = 1
    RMW_QOS_POLICY_HISTORY_KEEP_ALL = 2
    RMW_QOS_POLICY_HISTORY_UNKNOWN = 3


class ReliabilityPolicy(QoSPolicyEnum):
    """Whether messages may be lost in transport."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4
    RMW_QOS_POLICY_RELIABILITY_SYSTEM_DEFAULT = 0
    RMW_QOS_POLICY_RELIABILITY_RELIABLE = 1
    RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT = 2
    RMW_QOS_POLICY_RELIABILITY_UNKNOWN = 3


class DurabilityPolicy(QoSPolicyEnum):
    """Whether late joiners get earlier messages."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4
    RMW_QOS_POLICY_DURABILITY_SYSTEM_DEFAULT = 0
    RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL = 1
    RMW_QOS_POLICY_DURABILITY_VOLATILE = 2
    RMW_QOS_POLICY_DURABILITY_UNKNOWN = 3


class LivelinessPolicy(QoSPolicyEnum):
    """The sign by which a publisher shows that it is alive."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5
    RMW_QOS_POLICY_LIVELINESS_SYSTEM_DEFAULT = 0
    RMW_QOS_POLICY_LIVELINESS_AUTOMATIC = 1
    RMW_QOS_POLICY_LIVELINESS_MANUAL_BY_TOPIC = 3
    RMW_QOS_POLICY_LIVELINESS_UNKNOWN = 4


QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy

P = TypeVar("P", bound=QoSPolicyEnum)
V = TypeVar("V")

_UNSPECIFIED = Duration()
_BEST_AVAILABLE = Duration(nanoseconds=2**63 - 2)
"""rmw's value for a deadline or lease that adapts to the other side's."""


class InvalidQoSProfileException(Exception):
    """A profile without history and depth."""

    def __init__(self, *args: object) -> None:
        super().__init__("Invalid QoSProfile", *args)


class _Policy(Generic[P]):
    """A field that holds an enum and accepts its numbers too."""

    def __init__(self, kind: type[P]) -> None:
        self._kind = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._slot = f"_{name}"

    @overload
    def __get__(self, profile: None, owner: type) -> "_Policy[P]": ...
    @overload
    def __get__(self, profile: object, owner: type) -> P: ...
    def __get__(self, profile: object | None, owner: type) -> "P | _Policy[P]":
        if profile is None:
            return self
        value: P = getattr(profile, self._slot)
        return value

    def __set__(self, profile: object, value: P | int) -> None:
        assert isinstance(value, int), f"{self._slot[1:]} must be a {self._kind.__name__}, not {value!r}"
        setattr(profile, self._slot, self._kind(value))


class _Value(Generic[V]):
    """A field that holds a value of one class."""

    def __init__(self, kind: type[V]) -> None:
        self._kind = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._slot = f"_{name}"

    @overload
    def __get__(self, profile: None, owner: type) -> "_Value[V]": ...
    @overload
    def __get__(self, profile: object, owner: type) -> V: ...
    def __get__(self, profile: object | None, owner: type) -> "V | _Value[V]":
        if profile is None:
            return self
        value: V = getattr(profile, self._slot)
        return value

    def __set__(self, profile: object, value: V) -> None:
        assert isinstance(value, self._kind), (
            f"{self._slot[1:]} must be a {self._kind.__name__}, not {value!r}"
        )
        setattr(profile, self._slot, value)


class _Depth(_Value[int]):
    """A depth; setting 0 with KEEP_LAST warns."""

    def __set__(self, profile: object, value: int) -> None:
        super().__set__(profile, value)
        assert isinstance(profile, QoSProfile)
        _warn_of_no_depth(profile)


def _warn_of_no_depth(profile: "QoSProfile") -> None:
    """The warning names the line of the program that sets the depth, or makes the profile."""
    if profile.depth == 0 and profile.history is HistoryPolicy.KEEP_LAST:
        warnings.warn(
            "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
            "This will be interpreted as SYSTEM_DEFAULT",
            stacklevel=3,
        )


class QoSProfile:
    """The policies of one endpoint. Each can be changed until an endpoint is made from it.

    A deadline, lifespan or lease of `Duration()` is unset: no limit. Raises InvalidQoSProfileException
    without history and depth, AssertionError for a value of the wrong class, ValueError for an unknown
    number.
    """

    __slots__ = (  # noqa: RUF023 - the order of the text
        "_history",
        "_depth",
        "_reliability",
        "_durability",
        "_lifespan",
        "_deadline",
        "_liveliness",
        "_liveliness_lease_duration",
        "_avoid_ros_namespace_conventions",
    )  # fmt: skip

    history = _Policy(HistoryPolicy)
    depth = _Depth(int)
    reliability = _Policy(ReliabilityPolicy)
    durability = _Policy(DurabilityPolicy)
    lifespan = _Value(Duration)
    deadline = _Value(Duration)
    liveliness = _Policy(LivelinessPolicy)
    liveliness_lease_duration = _Value(Duration)
    avoid_ros_namespace_conventions = _Value(bool)

    def __init__(self, **kwargs: Any) -> None:
        unknown = [name for name in kwargs if f"_{name}" not in self.__slots__]
        assert not unknown, f"Invalid arguments passed to constructor: {unknown}"
        if "history" not in kwargs and "depth" not in kwargs:
            raise InvalidQoSProfileException("History and/or depth settings are required.")
        self.history = kwargs.get("history", HistoryPolicy.KEEP_LAST)
        if self.history is HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        _Value.__set__(QoSProfile.depth, self, kwargs.get("depth", native.default.depth))
        _warn_of_no_depth(self)
        self.reliability = kwargs.get("reliability", ReliabilityPolicy.RELIABLE)
        self.durability = kwargs.get("durability", DurabilityPolicy.VOLATILE)
        self.lifespan = kwargs.get("lifespan", _UNSPECIFIED)
        self.deadline = kwargs.get("deadline", _UNSPECIFIED)
        self.liveliness = kwargs.get("liveliness", LivelinessPolicy.SYSTEM_DEFAULT)
        self.liveliness_lease_duration = kwargs.get("liveliness_lease_duration", _UNSPECIFIED)
        self.avoid_ros_namespace_conventions = kwargs.get("avoid_ros_namespace_conventions", False)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, QoSProfile):
            return False
        return all(getattr(self, slot) == getattr(other, slot) for slot in self.__slots__)

    __hash__ = None  # type: ignore[assignment]

    def get_c_qos_profile(self) -> "CProfile":
        """The profile for entities of `rclpy_implementation`."""
        return CProfile(self)

    def __str__(self) -> str:
        fields = ", ".join(f"{slot[1:]}={getattr(self, slot)!s}" for slot in self.__slots__)
        return f"{type(self).__name__}({fields})"

    __repr__ = __str__


qos_profile_unknown = QoSProfile(
    history=HistoryPolicy.UNKNOWN,
    depth=0,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
qos_profile_default = QoSProfile(depth=10)
qos_profile_system_default = QoSProfile(
    history=HistoryPolicy.SYSTEM_DEFAULT,
    depth=0,
    reliability=ReliabilityPolicy.SYSTEM_DEFAULT,
    durability=DurabilityPolicy.SYSTEM_DEFAULT,
)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
qos_profile_services_default = QoSProfile(depth=10)
qos_profile_parameters = QoSProfile(depth=1000)
qos_profile_parameter_events = QoSProfile(depth=1000)
qos_profile_rosout_default = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)
qos_profile_action_status_default = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
qos_profile_best_available = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    deadline=_BEST_AVAILABLE,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=_BEST_AVAILABLE,
)


class QoSPresetProfiles(Enum):
    """The presets by name."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ROSOUT_DEFAULT = qos_profile_rosout_default
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available

    @classmethod
    def short_keys(cls) -> list[str]:
        """The names for a command line: in lower case."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """The profile for a name in any case; raises KeyError."""
        return cls[name.upper()].value


class CProfile:
    """A profile in the form of rclpy's C library, for making entities of `rclpy_implementation`."""

    def __init__(self, profile: QoSProfile) -> None:
        self.profile = profile

    def to_dict(self) -> dict[str, Any]:
        """The value of each policy, enums as numbers."""
        values = {name[1:]: getattr(self.profile, name[1:]) for name in QoSProfile.__slots__}
        return {name: int(value) if isinstance(value, IntEnum) else value for name, value in values.items()}


def profile_of(qos_or_depth: QoSProfile | int) -> QoSProfile:
    """The profile for `create_publisher(..., 10)`: an int is keep last with that depth.

    Raises ValueError for a negative depth, TypeError for any other type.
    """
    if isinstance(qos_or_depth, QoSProfile):
        return qos_or_depth
    if not isinstance(qos_or_depth, int):
        raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
    if qos_or_depth < 0:
        raise ValueError("history depth must be greater than or equal to zero")
    return QoSProfile(depth=qos_or_depth)


_POLICIES: dict[str, type[QoSPolicyEnum]] = {
    "history": HistoryPolicy,
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "liveliness": LivelinessPolicy,
}

# "Best available" matches every peer, known now or not: a publisher offers the most, a subscription requests
# the least. rmw decides once, by the peers of the moment.
_BEST_OFFER: dict[str, StrEnum] = {
    "reliability": native.Reliability.RELIABLE,
    "durability": native.Durability.TRANSIENT_LOCAL,
    "liveliness": native.Liveliness.MANUAL_BY_TOPIC,
}
_LEAST_REQUEST: dict[str, StrEnum] = {
    "reliability": native.Reliability.BEST_EFFORT,
    "durability": native.Durability.BEST_AVAILABLE,
    "liveliness": native.Liveliness.AUTOMATIC,
}
_BOTH: dict[str, StrEnum] = {
    "reliability": native.Reliability.BEST_EFFORT,
    "durability": native.Durability.VOLATILE,
    "liveliness": native.Liveliness.AUTOMATIC,
}


def to_native(
    profile: QoSProfile | int, *, for_publisher: bool = False, for_both: bool = False
) -> native.QoSProfile:
    """The bus's profile: for a publisher, for both ends of a service, or else for a subscription.

    The choice matters only for "best available".

    Raises InvalidQoSProfileException for an unknown policy, ValueError for values out of range.
    """
    profile = profile_of(profile)
    best = _BOTH if for_both else _BEST_OFFER if for_publisher else _LEAST_REQUEST
    depth = profile.depth if profile.depth or profile.history is HistoryPolicy.KEEP_ALL else 10
    fields: dict[str, Any] = {
        one.name: _choice(one, getattr(profile, one.name), best) for one in native.CHOICES
    }
    fields |= {one.name: _seconds(getattr(profile, one.name)) for one in native.DURATIONS}
    return native.QoSProfile(depth, **fields)


def from_native(profile: native.QoSProfile) -> QoSProfile:
    """The graph's profile as rclpy shows it: `Infinite` for no limit."""
    fields = {name: kind[getattr(profile, name).name] for name, kind in _POLICIES.items()}
    times = {one.name: _duration(one.ns(profile)) for one in native.DURATIONS}
    return QoSProfile(depth=profile.depth, **fields, **times)


def _choice(policy: native.PolicyField, value: QoSPolicyEnum, best: Mapping[str, StrEnum]) -> Any:
    if value.name == "SYSTEM_DEFAULT":
        return getattr(native.default, policy.name)
    if value.name == "BEST_AVAILABLE":
        return best[policy.name]
    found = policy.offers.get(value)
    if found is None:
        raise InvalidQoSProfileException(f"{value!r} is no choice for an endpoint")
    return found


def _seconds(duration: Duration) -> float | None:
    if duration == _UNSPECIFIED or duration >= _BEST_AVAILABLE:
        return None
    return duration.nanoseconds / 1e9


def _duration(duration_ns: int) -> Duration:
    return Duration(nanoseconds=duration_ns) if duration_ns else Infinite


class QoSCompatibility(IntEnum):
    """Whether a publisher and a subscription match; WARNING: in ROS 2, a system default decides it."""

    OK = 0
    WARNING = 1
    ERROR = 2


class _Open(NamedTuple):
    """A policy, and the texts of its warnings if one side or both leave it open."""

    weak_offer: QoSPolicyEnum
    strong_request: QoSPolicyEnum
    both_open: str
    open_offer: str
    open_request: str


_OPEN = {
    "reliability": _Open(
        ReliabilityPolicy.BEST_EFFORT,
        ReliabilityPolicy.RELIABLE,
        "Publisher reliability is {offer} and subscription reliability is {request}",
        "Reliable subscription, but publisher is {offer}",
        "Best effort publisher, but subscription is {request}",
    ),
    "durability": _Open(
        DurabilityPolicy.VOLATILE,
        DurabilityPolicy.TRANSIENT_LOCAL,
        "Publisher durabilty is {offer} and subscription durability is {request}",
        "Transient local subscription, but publisher is {offer}",
        "Volatile publisher, but subscription is {request}",
    ),
    "liveliness": _Open(
        LivelinessPolicy.AUTOMATIC,
        LivelinessPolicy.MANUAL_BY_TOPIC,
        "Publisher liveliness is {offer} and subscription liveliness is {request}",
        "Subscription's liveliness is manual by topic, but publisher's is {offer}",
        "Publisher's liveliness is automatic, but subscription's is {request}",
    ),
}
"""The texts are rmw's, with its spelling."""


def qos_check_compatible(
    publisher_qos: QoSProfile, subscription_qos: QoSProfile
) -> tuple[QoSCompatibility, str]:
    """Whether the two would match, and the reasons against it, in rmw's words.

    A policy that is open (system default, unknown) is no error, but may be a warning.
    """
    offered, requested = copy(publisher_qos), copy(subscription_qos)
    offered.history = requested.history = HistoryPolicy.KEEP_LAST  # both sides choose alone
    doubts = []
    for name, policy in _OPEN.items():
        offer, request = getattr(offered, name), getattr(requested, name)
        if _is_open(offer):
            setattr(offered, name, policy.strong_request)
        if _is_open(request):
            setattr(requested, name, policy.weak_offer)
        if doubt := _doubt(policy, offer, request):
            text = doubt.format(offer=offer.short_key, request=request.short_key)
            doubts.append(f"WARNING: {text};")
    found = native.check_compatible(to_native(offered, for_publisher=True), to_native(requested))
    if found:
        return QoSCompatibility.ERROR, native.describe_incompatibilities(found)
    return QoSCompatibility.WARNING if doubts else QoSCompatibility.OK, "".join(doubts)


def _doubt(policy: _Open, offer: QoSPolicyEnum, request: QoSPolicyEnum) -> str | None:
    if _is_open(offer):
        if _is_open(request):
            return policy.both_open
        return policy.open_offer if request is policy.strong_request else None
    return policy.open_request if _is_open(request) and offer is policy.weak_offer else None


def _is_open(value: QoSPolicyEnum) -> bool:
    return value.name in ("SYSTEM_DEFAULT", "UNKNOWN")

"""QoS that the user may override by parameters: `qos_overrides./topic.publisher.depth` and the like.

Owns their names, their values and their effect on a profile. Must not know the storage of parameters.
"""

from collections.abc import Callable, Iterable
from typing import Any

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import ParameterAlreadyDeclaredException
from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyEnum,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)

__all__ = [
    "InvalidQosOverridesError",
    "QoSOverridingOptions",
    "QosCallbackResult",  # noqa: F822 - made by __getattr__
    "declare_qos_parameters",
]


class InvalidQosOverridesError(Exception):
    """The callback of the options refuses the profile with the parameters' values."""


class QoSOverridingOptions:
    """The policies of an endpoint that have a parameter.

    `callback(profile)` checks the resulting profile and returns a QosCallbackResult. `entity_id`
    distinguishes endpoints of one topic.
    """

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: Callable[[QoSProfile], Any] | None = None,
        entity_id: str | None = None,
    ) -> None:
        self._policy_kinds = policy_kinds
        self._callback = callback
        self._entity_id = entity_id

    @property
    def policy_kinds(self) -> Iterable[QoSPolicyKind]:
        return self._policy_kinds

    @property
    def callback(self) -> Callable[[QoSProfile], Any] | None:
        return self._callback

    @property
    def entity_id(self) -> str | None:
        return self._entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: Callable[[QoSProfile], Any] | None = None, entity_id: str | None = None
    ) -> "QoSOverridingOptions":
        """Options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


_ENUMS: dict[QoSPolicyKind, type[QoSPolicyEnum]] = {
    QoSPolicyKind.DURABILITY: DurabilityPolicy,
    QoSPolicyKind.HISTORY: HistoryPolicy,
    QoSPolicyKind.LIVELINESS: LivelinessPolicy,
    QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
}
_DURATIONS = (QoSPolicyKind.LIFESPAN, QoSPolicyKind.DEADLINE, QoSPolicyKind.LIVELINESS_LEASE_DURATION)


def declare_qos_parameters(
    entity_type: str, node: NodeParameters, topic_name: str, qos: QoSProfile, options: QoSOverridingOptions
) -> QoSProfile:
    """Declare the parameters of a "publisher" or a "subscription" and return `qos`, changed by their values.

    Raises InvalidQosOverridesError if the callback refuses the profile, RuntimeError if a value is invalid
    for its policy.
    """
    from bus_ros.rosidl import message_class  # late: few programs have overrides

    descriptor_class: Any = message_class("rcl_interfaces/msg/ParameterDescriptor")
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    what = f"for {entity_type} `{topic_name}` with id `{options.entity_id}`"
    for kind in options.policy_kinds:
        if kind is QoSPolicyKind.INVALID or (
            kind is QoSPolicyKind.LIFESPAN and entity_type == "subscription"
        ):
            continue
        policy = kind.name.lower()
        name = f"qos_overrides.{topic_name}.{entity_type}{suffix}.{policy}"
        descriptor = descriptor_class(description=f"{policy} {what}", read_only=True)
        try:
            parameter: Any = node.declare_parameter(name, _parameter_value(qos, kind), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _override(qos, kind, parameter.value)
    if options.callback is not None:
        result = options.callback(qos)
        if not result.successful:
            raise InvalidQosOverridesError(f"Provided QoS overrides {what}, are not valid: {result.reason}")
    return qos


def _parameter_value(qos: QoSProfile, kind: QoSPolicyKind) -> str | int | bool:
    value: Any = getattr(qos, kind.name.lower())
    if kind in _ENUMS:
        if value.name == "UNKNOWN":
            raise ValueError("User provided QoS profile is invalid")
        return str(value.short_key)
    if kind in _DURATIONS:
        return int(value.nanoseconds)
    return value  # type: ignore[no-any-return]


def _override(qos: QoSProfile, kind: QoSPolicyKind, value: Any) -> None:
    policy = kind.name.lower()
    if kind in _ENUMS:
        try:
            value = _ENUMS[kind][value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{policy}`: `{value}`") from None
    elif kind in _DURATIONS:
        value = Duration(nanoseconds=value)
    setattr(qos, policy, value)


# --- rclpy's private names, which tests of programs use


def _get_allowed_policies(entity_type: type) -> list[QoSPolicyKind]:
    """The policies that the class Publisher or Subscription has."""
    is_publisher = entity_type.__name__ == "Publisher"
    return [kind for kind in QoSPolicyKind if is_publisher or kind is not QoSPolicyKind.LIFESPAN]


def _declare_qos_parameters(
    entity_type: type, node: NodeParameters, topic_name: str, qos: QoSProfile, options: QoSOverridingOptions
) -> None:
    """As `declare_qos_parameters`, with the class Publisher or Subscription."""
    declare_qos_parameters(entity_type.__name__.lower(), node, topic_name, qos, options)


_get_qos_policy_parameter = _parameter_value


def _override_qos_policy_with_param(qos: QoSProfile, policy: QoSPolicyKind, param: Any) -> None:
    _override(qos, policy, param.value)


def __getattr__(name: str) -> Any:
    if name == "QosCallbackResult":  # a message class, made at its first use as all of them
        from bus_ros.rosidl import message_class

        return message_class("rcl_interfaces/msg/SetParametersResult")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

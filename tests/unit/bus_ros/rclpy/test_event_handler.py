"""Events of the facade, QoS overrides by parameters, and information about endpoints."""

from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from bus import events as native
from bus import qos as native_qos
from bus.graph import GraphEndpoint, GraphNode
from bus_ros.rclpy import event_handler, qos_overriding_options
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.event_handler import (
    IncompatibleTypeInfo,
    PublisherEventCallbacks,
    QoSLivelinessChangedInfo,
    QoSLivelinessLostInfo,
    QoSMessageLostInfo,
    QoSOfferedDeadlineMissedInfo,
    QoSOfferedIncompatibleQoSInfo,
    QoSPublisherMatchedInfo,
    QoSRequestedDeadlineMissedInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
    publisher_events,
    subscription_events,
)
from bus_ros.rclpy.exceptions import ParameterAlreadyDeclaredException
from bus_ros.rclpy.impl.endpoint_events import EndpointEvents
from bus_ros.rclpy.qos import HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from bus_ros.rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QoSOverridingOptions,
    declare_qos_parameters,
)
from bus_ros.rclpy.topic_endpoint_info import EndpointTypeEnum, TopicEndpointInfo
from bus_ros.rosidl import message_class

MATCHED = native.MatchedChange(2, 1, 5, 1, "/other")
QOS = native.IncompatibleQoS(3, 1, "RELIABILITY", "ERROR: ...;", "/other")
TYPE = native.IncompatibleType(4, 1, "another type", "/other")
DEADLINE = native.DeadlineMissed(6, 1)


class Line:
    """Calls that wait for the executor."""

    def __init__(self) -> None:
        self.calls: list[tuple[Callable[[Any], Any], Any]] = []

    def enqueue(self, callback: Callable[[Any], Any], info: Any) -> None:
        self.calls.append((callback, info))

    def infos(self) -> list[Any]:
        return [info for _, info in self.calls]


def fire(events: Any, **happened: Any) -> None:
    for name, event in happened.items():
        getattr(events, name)(event)


def test_events_of_a_subscription() -> None:
    line = Line()
    callbacks = dict.fromkeys(
        ("deadline", "incompatible_qos", "liveliness", "message_lost", "incompatible_type", "matched"), print
    )
    events = subscription_events(SubscriptionEventCallbacks(**callbacks), line.enqueue)  # type: ignore[arg-type]
    assert isinstance(events, native.SubscriptionEvents)
    fire(
        events,
        matched=MATCHED,
        incompatible_qos=QOS,
        incompatible_type=TYPE,
        deadline_missed=DEADLINE,
        liveliness_changed=native.LivelinessChanged(1, 2, 3, 4),
        message_lost=native.MessageLost(7, 2, {"replaced": 7}),
    )
    assert line.infos() == [
        QoSSubscriptionMatchedInfo(
            total_count=5, total_count_change=1, current_count=2, current_count_change=1
        ),
        QoSRequestedIncompatibleQoSInfo(3, 1, QoSPolicyKind.RELIABILITY),
        IncompatibleTypeInfo(4, 1),
        QoSRequestedDeadlineMissedInfo(6, 1),
        QoSLivelinessChangedInfo(1, 2, 3, 4),
        QoSMessageLostInfo(7, 2),
    ]
    assert {callback for callback, _ in line.calls} == {print}


def test_events_of_a_publisher() -> None:
    line = Line()
    callbacks = PublisherEventCallbacks(
        deadline=print, liveliness=print, incompatible_qos=print, incompatible_type=print, matched=print
    )
    events = publisher_events(callbacks, line.enqueue)
    assert isinstance(events, native.PublisherEvents)
    fire(
        events,
        matched=MATCHED,
        incompatible_qos=QOS._replace(policy="NEW"),
        incompatible_type=TYPE,
        deadline_missed=DEADLINE,
        liveliness_lost=native.LivelinessLost(8, 1),
    )
    assert line.infos() == [
        QoSPublisherMatchedInfo(total_count=5, total_count_change=1, current_count=2, current_count_change=1),
        QoSOfferedIncompatibleQoSInfo(3, 1, QoSPolicyKind.INVALID),
        IncompatibleTypeInfo(4, 1),
        QoSOfferedDeadlineMissedInfo(6, 1),
        QoSLivelinessLostInfo(8, 1),
    ]


@pytest.mark.parametrize(
    ("kind", "events_of"),
    [(SubscriptionEventCallbacks, subscription_events), (PublisherEventCallbacks, publisher_events)],
)
def test_without_callbacks_the_bus_warns_unless_told_not_to(kind: Any, events_of: Any) -> None:
    line = Line()
    loud = events_of(kind(), line.enqueue)
    silent = events_of(kind(use_default_callbacks=False), line.enqueue)
    assert loud.incompatible_qos is loud.incompatible_type is loud.matched is silent.matched is None
    fire(silent, incompatible_qos=QOS, incompatible_type=TYPE)
    assert line.calls == []


def test_one_value_of_each_kind_waits() -> None:
    """The newer one, with the changes of all since the last call."""
    node: Any = SimpleNamespace(own_executor=None, waiting=[])
    group: Any = None
    told: list[Any] = []
    callbacks = SubscriptionEventCallbacks(
        liveliness=told.append, incompatible_qos=told.append, message_lost=told.append
    )
    events = EndpointEvents(callbacks, subscription_events, node, group)
    fire(
        events.native,
        incompatible_qos=QOS,
        liveliness_changed=native.LivelinessChanged(1, 2, 3, 4),
        message_lost=native.MessageLost(7, 2, {"replaced": 7}),
    )
    fire(
        events.native,
        incompatible_qos=QOS._replace(total_count=4, policy="DURABILITY"),
        liveliness_changed=native.LivelinessChanged(5, 6, -7, 8),
    )
    while (work := events.take(1)) is not None:
        work[0](*work[1])
    assert told == [
        QoSRequestedIncompatibleQoSInfo(4, 2, QoSPolicyKind.DURABILITY),
        QoSLivelinessChangedInfo(5, 6, -4, 12),
        QoSMessageLostInfo(7, 2),
    ]
    assert node.waiting == [events]


def test_names_of_humble_and_rolling() -> None:
    of_humble = import_module("bus_ros.rclpy.qos_event")
    assert "SubscriptionEventCallbacks" in of_humble.__all__
    for name in of_humble.__all__:
        assert getattr(of_humble, name) is getattr(event_handler, name)
    assert import_module("bus_ros.rclpy.endpoint_info").TopicEndpointInfo is TopicEndpointInfo
    assert event_handler.QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST == 3
    assert event_handler.QoSPublisherEventType.RCL_PUBLISHER_MATCHED == 4
    assert issubclass(event_handler.UnsupportedEventTypeError, RuntimeError)


class Node:
    """The part of a node that overrides use."""

    def __init__(self, **overrides: object) -> None:
        self.overrides = overrides
        self.descriptors: dict[str, Any] = {}
        self.values: dict[str, object] = {}

    def declare_parameter(self, name: str, value: object, descriptor: Any) -> Any:
        if name in self.values:
            raise ParameterAlreadyDeclaredException(name)
        self.descriptors[name] = descriptor
        self.values[name] = self.overrides.get(name.rpartition(".")[2], value)
        return self.get_parameter(name)

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self.values[name])


def declare(node: Node, options: QoSOverridingOptions, kind: str = "publisher") -> QoSProfile:
    return declare_qos_parameters(kind, node, "/chatter", QoSProfile(depth=10), options)  # type: ignore[arg-type]


def test_overrides_change_the_profile() -> None:
    node = Node(depth=3, reliability="best_effort")
    qos = declare(node, QoSOverridingOptions.with_default_policies())
    assert (qos.depth, qos.reliability, qos.history) == (
        3,
        ReliabilityPolicy.BEST_EFFORT,
        HistoryPolicy.KEEP_LAST,
    )
    assert node.values == {
        "qos_overrides./chatter.publisher.history": "keep_last",
        "qos_overrides./chatter.publisher.depth": 3,
        "qos_overrides./chatter.publisher.reliability": "best_effort",
    }
    descriptor = node.descriptors["qos_overrides./chatter.publisher.depth"]
    assert descriptor.read_only
    assert descriptor.description == "depth for publisher `/chatter` with id `None`"
    again = declare(node, QoSOverridingOptions.with_default_policies())
    assert again == qos


def test_overrides_of_durations_flags_and_ids() -> None:
    node = Node(deadline=500_000_000)
    options = QoSOverridingOptions(list(QoSPolicyKind), entity_id="left")
    qos = declare(node, options, "subscription")
    assert qos.deadline == Duration(seconds=0.5)
    assert qos.avoid_ros_namespace_conventions is False
    names = [name.rpartition(".")[2] for name in node.values]
    assert "lifespan" not in names and "invalid" not in names and "durability" in names
    assert all(name.startswith("qos_overrides./chatter.subscription_left.") for name in node.values)


def test_overrides_that_are_wrong() -> None:
    with pytest.raises(RuntimeError, match="Unexpected QoS override for policy `reliability`: `perfect`"):
        declare(Node(reliability="perfect"), QoSOverridingOptions.with_default_policies())
    result = qos_overriding_options.QosCallbackResult
    assert result is message_class("rcl_interfaces/msg/SetParametersResult")
    seen: list[QoSProfile] = []

    def refuse(qos: QoSProfile) -> Any:
        seen.append(qos)
        return result(successful=False, reason="too deep")  # type: ignore[call-arg]

    with pytest.raises(InvalidQosOverridesError, match=r"Provided QoS overrides .* not valid: too deep"):
        declare(Node(), QoSOverridingOptions([QoSPolicyKind.DEPTH], callback=refuse))
    accept = QoSOverridingOptions([], callback=lambda qos: result(successful=True))  # type: ignore[call-arg]
    assert declare(Node(), accept) == seen[0]


def test_what_the_graph_knows_of_an_endpoint() -> None:
    text = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    endpoint = GraphEndpoint(
        id=1,
        kind="publisher",
        node=GraphNode(id=1, name="talker", namespace="/", pid=1),
        topic="/chatter",
        type_name="std_msgs/msg/String",
        type_hash=text,
        gid=bytes([1, 255]),
        qos=native_qos.QoSProfile(depth=7),
    )
    info = TopicEndpointInfo.from_graph(endpoint)
    assert info.endpoint_type is EndpointTypeEnum.PUBLISHER
    assert info == TopicEndpointInfo.from_graph(endpoint) != TopicEndpointInfo()
    assert str(info).splitlines() == [
        "Node name: talker",
        "Node namespace: /",
        "Topic type: std_msgs/msg/String",
        f"Topic type hash: {text}",
        "Endpoint type: PUBLISHER",
        "GID: 01.ff",
        "QoS profile:",
        "  Reliability: RELIABLE",
        "  History (Depth): KEEP_LAST (7)",
        "  Durability: VOLATILE",
        "  Lifespan: Infinite",
        "  Deadline: Infinite",
        "  Liveliness: AUTOMATIC",
        "  Liveliness lease duration: Infinite",
    ]

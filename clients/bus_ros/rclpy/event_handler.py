"""Callbacks for what happens to endpoints besides messages, and their values, as rclpy.event_handler.

Owns the translation of the bus's events. Must not know executors: the node gives `enqueue`, which puts a
callback in line.
"""

from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

from msgspec.structs import replace

from bus import events
from bus.base.callbacks import ignore
from bus.endpoint.core import EndpointCore
from bus.endpoint.endpoint import core_of
from bus_ros.rclpy.exceptions import UnsupportedEventTypeError
from bus_ros.rclpy.impl.executor_parts import await_or_execute
from bus_ros.rclpy.qos import QoSPolicyKind
from bus_ros.rclpy.waitable import NumberOfEntities, Waitable

__all__ = [
    "PUBLISHER_EVENTS",
    "SUBSCRIPTION_EVENTS",
    "EventHandler",
    "IncompatibleTypeInfo",
    "PublisherEventCallbacks",
    "QoSEventHandler",
    "QoSLivelinessChangedInfo",
    "QoSLivelinessLostInfo",
    "QoSMessageLostInfo",
    "QoSOfferedDeadlineMissedInfo",
    "QoSOfferedIncompatibleQoSInfo",
    "QoSPublisherEventType",
    "QoSPublisherMatchedInfo",
    "QoSRequestedDeadlineMissedInfo",
    "QoSRequestedIncompatibleQoSInfo",
    "QoSSubscriptionEventType",
    "QoSSubscriptionMatchedInfo",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
    "publisher_events",
    "subscription_events",
    "watch_event",
]


class QoSPublisherEventType(IntEnum):
    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(IntEnum):
    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


# In all of these, `..._change` counts since the event before.


class QoSRequestedDeadlineMissedInfo(NamedTuple):
    """No message came within the deadline."""

    total_count: int
    total_count_change: int


class QoSOfferedDeadlineMissedInfo(NamedTuple):
    """Nothing was published within the deadline."""

    total_count: int
    total_count_change: int


class QoSLivelinessChangedInfo(NamedTuple):
    """Publishers that show that they live, and those that don't any more."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


class QoSLivelinessLostInfo(NamedTuple):
    """This publisher did not show in time that it lives."""

    total_count: int
    total_count_change: int


class QoSMessageLostInfo(NamedTuple):
    """Messages that were dropped before they could be taken."""

    total_count: int
    total_count_change: int


class QoSRequestedIncompatibleQoSInfo(NamedTuple):
    """Endpoints of this topic that can't match; a policy in which the last of them differs."""

    total_count: int
    total_count_change: int
    last_policy_kind: QoSPolicyKind


QoSOfferedIncompatibleQoSInfo = QoSRequestedIncompatibleQoSInfo


class IncompatibleTypeInfo(NamedTuple):
    """Endpoints of this topic that have another type."""

    total_count: int
    total_count_change: int


class QoSPublisherMatchedInfo(NamedTuple):
    """Matches ever made, and those that there are."""

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


class QoSSubscriptionMatchedInfo(NamedTuple):
    """Matches ever made, and those that there are."""

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


Kinds: TypeAlias = Mapping[str, tuple[IntEnum, Any]]
PUBLISHER_EVENTS: Kinds = {
    "deadline": (
        QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
        QoSOfferedDeadlineMissedInfo,
    ),
    "liveliness": (QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST, QoSLivelinessLostInfo),
    "incompatible_qos": (
        QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
        QoSOfferedIncompatibleQoSInfo,
    ),
    "incompatible_type": (QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE, IncompatibleTypeInfo),
    "matched": (QoSPublisherEventType.RCL_PUBLISHER_MATCHED, QoSPublisherMatchedInfo),
}
"""By the name of their callback: the number of an event, and the class of its value."""
SUBSCRIPTION_EVENTS: Kinds = {
    "deadline": (
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
        QoSRequestedDeadlineMissedInfo,
    ),
    "incompatible_qos": (
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
        QoSRequestedIncompatibleQoSInfo,
    ),
    "liveliness": (
        QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
        QoSLivelinessChangedInfo,
    ),
    "message_lost": (QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST, QoSMessageLostInfo),
    "incompatible_type": (QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE, IncompatibleTypeInfo),
    "matched": (QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED, QoSSubscriptionMatchedInfo),
}

Callback: TypeAlias = Callable[[Any], object] | None
Enqueue: TypeAlias = Callable[[Callable[[Any], object], object], object]
"""`enqueue(callback, info)` has the executor call `callback(info)`."""


class EventHandler(Waitable):
    """A callback and what it is for, as rclpy lists them.

    Nobody need wait for it: the bus calls back. One in a program's own wait set hears of the event besides.
    """

    def __init__(
        self, *, callback_group: Any, callback: Callable[[Any], object], event_type: IntEnum, parent_impl: Any
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self.event_type = event_type
        self.parent = parent_impl
        self._event: Any = None
        self._index: int | None = None

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_events=1)

    def add_to_wait_set(self, wait_set: Any) -> None:
        if self._event is None:
            from bus_ros.rclpy.impl.events import EventHandle  # late: few programs have wait sets

            self._event = EventHandle(self.parent, self.event_type)
        self._index = wait_set.add_event(self._event)

    def is_ready(self, wait_set: Any) -> bool:
        return self._index is not None and bool(wait_set.is_ready("event", self._index))

    def take_data(self) -> Any:
        """The event's value."""
        return self._event.take_event()

    async def execute(self, taken_data: Any) -> None:
        """Call back with the value."""
        await await_or_execute(self.callback, taken_data)

    def destroy(self) -> None:
        """Its endpoint's end ends it."""


QoSEventHandler = EventHandler


def _warn(info: object) -> None:
    """Stands for the warning that the bus logs itself."""


class _Callbacks:
    """Base of the two."""

    use_default_callbacks: bool

    def _handlers(self, kinds: Kinds, group: Any, parent: Any) -> list[EventHandler]:
        found = []
        for name, (event_type, _) in kinds.items():
            callback = getattr(self, name)
            if callback is None and self.use_default_callbacks and name.startswith("incompatible"):
                callback = _warn
            if callback is not None:
                found.append(
                    EventHandler(
                        callback_group=group, callback=callback, event_type=event_type, parent_impl=parent
                    )
                )
        return found


class SubscriptionEventCallbacks(_Callbacks):
    """A subscription's callbacks, each called with the value of its event.

    `use_default_callbacks`: where there is none for incompatible QoS or types, a warning is logged.
    """

    def __init__(
        self,
        *,
        deadline: Callback = None,
        incompatible_qos: Callback = None,
        liveliness: Callback = None,
        message_lost: Callback = None,
        incompatible_type: Callback = None,
        matched: Callback = None,
        use_default_callbacks: bool = True,
    ) -> None:
        self.deadline = deadline
        self.incompatible_qos = incompatible_qos
        self.liveliness = liveliness
        self.message_lost = message_lost
        self.incompatible_type = incompatible_type
        self.matched = matched
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(
        self, callback_group: Any, subscription: Any, topic_name: str
    ) -> list[EventHandler]:
        """One for each callback, and for what is warned of."""
        return self._handlers(SUBSCRIPTION_EVENTS, callback_group, subscription)


class PublisherEventCallbacks(_Callbacks):
    """A publisher's callbacks, each called with the value of its event.

    `use_default_callbacks`: where there is none for incompatible QoS or types, a warning is logged.
    """

    def __init__(
        self,
        *,
        deadline: Callback = None,
        liveliness: Callback = None,
        incompatible_qos: Callback = None,
        incompatible_type: Callback = None,
        matched: Callback = None,
        use_default_callbacks: bool = True,
    ) -> None:
        self.deadline = deadline
        self.liveliness = liveliness
        self.incompatible_qos = incompatible_qos
        self.incompatible_type = incompatible_type
        self.matched = matched
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(
        self, callback_group: Any, publisher: Any, topic_name: str
    ) -> list[EventHandler]:
        """One for each callback, and for what is warned of."""
        return self._handlers(PUBLISHER_EVENTS, callback_group, publisher)


def subscription_events(callbacks: SubscriptionEventCallbacks, enqueue: Enqueue) -> events.SubscriptionEvents:
    """The bus's events of a subscription with these callbacks."""
    silent = None if callbacks.use_default_callbacks else ignore
    return events.SubscriptionEvents(
        matched=_on(callbacks.matched, enqueue, lambda e: QoSSubscriptionMatchedInfo(*_matched(e))),
        incompatible_qos=_on(callbacks.incompatible_qos, enqueue, _incompatible_qos, silent),
        incompatible_type=_on(callbacks.incompatible_type, enqueue, _incompatible_type, silent),
        deadline_missed=_on(callbacks.deadline, enqueue, lambda e: QoSRequestedDeadlineMissedInfo(*e)),
        liveliness_changed=_on(callbacks.liveliness, enqueue, lambda e: QoSLivelinessChangedInfo(*e)),
        message_lost=_on(callbacks.message_lost, enqueue, lambda e: QoSMessageLostInfo(*e[:2])),
    )


def publisher_events(callbacks: PublisherEventCallbacks, enqueue: Enqueue) -> events.PublisherEvents:
    """The bus's events of a publisher with these callbacks."""
    silent = None if callbacks.use_default_callbacks else ignore
    return events.PublisherEvents(
        matched=_on(callbacks.matched, enqueue, lambda e: QoSPublisherMatchedInfo(*_matched(e))),
        incompatible_qos=_on(callbacks.incompatible_qos, enqueue, _incompatible_qos, silent),
        incompatible_type=_on(callbacks.incompatible_type, enqueue, _incompatible_type, silent),
        deadline_missed=_on(callbacks.deadline, enqueue, lambda e: QoSOfferedDeadlineMissedInfo(*e)),
        liveliness_lost=_on(callbacks.liveliness, enqueue, lambda e: QoSLivelinessLostInfo(*e)),
    )


def watch_event(native: Any, event_type: IntEnum, enqueue: Enqueue) -> Any:
    """Under the guard: have an endpoint that is there give each event of a kind to `enqueue` besides.

    Returns the value until now: of matches, for other events are known from now on. Raises TypeError where
    the kind is not one of the endpoint's.
    """
    core: EndpointCore[Any] = core_of(native)
    is_publisher = core.kind == "publisher"
    kinds = PUBLISHER_EVENTS if is_publisher else SUBSCRIPTION_EVENTS
    # Numbers are not enough: both kinds of endpoints have the same.
    found = [(name, info) for name, (one, info) in kinds.items() if one is event_type]
    if not found:
        raise TypeError(f"{event_type!r} is no event of a {core.kind}")
    ((name, info),) = found
    callbacks: dict[str, Any] = {name: ignore}
    wanted: Any = (
        publisher_events(PublisherEventCallbacks(**callbacks), enqueue)
        if is_publisher
        else subscription_events(SubscriptionEventCallbacks(**callbacks), enqueue)
    )
    field, tell = next((one, call) for one in wanted.__struct_fields__ if (call := getattr(wanted, one)))
    before = getattr(core.events, field)

    def both(event: Any) -> None:
        tell(event)
        if before is not None:
            before(event)

    core.events = replace(core.events, **{field: both})
    if name == "matched":
        total, now = core.matches.total, len(core.matches)
        return info(total, total, now, now)
    return info(*(QoSPolicyKind.INVALID if one == "last_policy_kind" else 0 for one in info._fields))


def _on(
    callback: Callback, enqueue: Enqueue, convert: Callable[[Any], object], otherwise: Callback = None
) -> Callback:
    """The callback for the bus; None where the bus logs its own warning."""
    if callback is None:
        return otherwise
    return lambda event: enqueue(callback, convert(event))


def _matched(event: events.MatchedChange) -> tuple[int, int, int, int]:
    return event.total_count, event.total_count_change, event.current_count, event.current_count_change


def _incompatible_qos(event: events.IncompatibleQoS) -> QoSRequestedIncompatibleQoSInfo:
    try:
        kind = QoSPolicyKind[event.policy]
    except KeyError:  # a busd newer than this library
        kind = QoSPolicyKind.INVALID
    return QoSRequestedIncompatibleQoSInfo(event.total_count, event.total_count_change, kind)


def _incompatible_type(event: events.IncompatibleType) -> IncompatibleTypeInfo:
    return IncompatibleTypeInfo(event.total_count, event.total_count_change)

"""Callbacks for events of endpoints other than messages, and their values, as rclpy.event_handler.

Owns the translation of the bus's events. Must not know executors: the node passes `enqueue`, which gives a
callback to the executor.
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


# In all of these classes, `..._change` counts since the previous event.


class QoSRequestedDeadlineMissedInfo(NamedTuple):
    """No message came within the deadline."""

    total_count: int
    total_count_change: int


class QoSOfferedDeadlineMissedInfo(NamedTuple):
    """Nothing was published within the deadline."""

    total_count: int
    total_count_change: int


class QoSLivelinessChangedInfo(NamedTuple):
    """The numbers of publishers that are alive, and that have stopped showing it."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


class QoSLivelinessLostInfo(NamedTuple):
    """This publisher did not assert its liveliness in time."""

    total_count: int
    total_count_change: int


class QoSMessageLostInfo(NamedTuple):
    """Messages that were dropped before the subscription took them."""

    total_count: int
    total_count_change: int


class QoSRequestedIncompatibleQoSInfo(NamedTuple):
    """Endpoints of this topic with incompatible QoS, and a policy in which the last one differs."""

    total_count: int
    total_count_change: int
    last_policy_kind: QoSPolicyKind


QoSOfferedIncompatibleQoSInfo = QoSRequestedIncompatibleQoSInfo


class IncompatibleTypeInfo(NamedTuple):
    """Endpoints of this topic that have another type."""

    total_count: int
    total_count_change: int


class QoSPublisherMatchedInfo(NamedTuple):
    """All matches so far, and the present ones."""

    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


class QoSSubscriptionMatchedInfo(NamedTuple):
    """All matches so far, and the present ones."""

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
"""Kinds of events: the name of a callback to the number of the event and the class of its value."""
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
"""`enqueue(callback, info)` makes the executor call `callback(info)`."""


class EventHandler(Waitable):
    """A callback and its kind of event, as rclpy lists them.

    No executor has to wait for it: the bus calls it. In a program's wait set, it also gets the event.
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
        """Call the callback with the value."""
        await await_or_execute(self.callback, taken_data)

    def destroy(self) -> None:
        """Does nothing: it ends with its endpoint."""


QoSEventHandler = EventHandler


def _warn(info: object) -> None:
    """Placeholder for the warning that the bus logs itself."""


class _Callbacks:
    """Base of both classes."""

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

    `use_default_callbacks`: without a callback for incompatible QoS or types, busd's library logs a warning.
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
        """One handler for each callback, and for each warning."""
        return self._handlers(SUBSCRIPTION_EVENTS, callback_group, subscription)


class PublisherEventCallbacks(_Callbacks):
    """A publisher's callbacks, each called with the value of its event.

    `use_default_callbacks`: without a callback for incompatible QoS or types, busd's library logs a warning.
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
        """One handler for each callback, and for each warning."""
        return self._handlers(PUBLISHER_EVENTS, callback_group, publisher)


def subscription_events(callbacks: SubscriptionEventCallbacks, enqueue: Enqueue) -> events.SubscriptionEvents:
    """These callbacks as the bus's events of a subscription."""
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
    """These callbacks as the bus's events of a publisher."""
    silent = None if callbacks.use_default_callbacks else ignore
    return events.PublisherEvents(
        matched=_on(callbacks.matched, enqueue, lambda e: QoSPublisherMatchedInfo(*_matched(e))),
        incompatible_qos=_on(callbacks.incompatible_qos, enqueue, _incompatible_qos, silent),
        incompatible_type=_on(callbacks.incompatible_type, enqueue, _incompatible_type, silent),
        deadline_missed=_on(callbacks.deadline, enqueue, lambda e: QoSOfferedDeadlineMissedInfo(*e)),
        liveliness_lost=_on(callbacks.liveliness, enqueue, lambda e: QoSLivelinessLostInfo(*e)),
    )


def watch_event(native: Any, event_type: IntEnum, enqueue: Enqueue) -> Any:
    """Under the guard: pass each event of a kind of an existing endpoint to `enqueue`, too.

    Returns the value until now for matches; other events count from now on. Raises TypeError if the endpoint
    has no events of that kind.
    """
    core: EndpointCore[Any] = core_of(native)
    is_publisher = core.kind == "publisher"
    kinds = PUBLISHER_EVENTS if is_publisher else SUBSCRIPTION_EVENTS
    # The number alone is ambiguous: both kinds of endpoints use the same numbers.
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
    """The callback for the bus; `otherwise` if the program has none."""
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

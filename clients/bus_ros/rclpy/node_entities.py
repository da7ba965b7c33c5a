"""How a node of the facade makes and destroys what executors work off.

Owns the lists of a node's entities. Must not know parameters, or what else a node is.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from copy import copy
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeVar

from bus.errors import ConfigurationError
from bus.events import PublisherEvents, SubscriptionEvents
from bus.node import Node as NativeNode
from bus.qos import QoSProfile as NativeProfile
from bus.service_host import SERVICE_QOS
from bus_ros.engine import Engine
from bus_ros.entity import Calls, Entity
from bus_ros.rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from bus_ros.rclpy.client import Client
from bus_ros.rclpy.clock import Clock
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.exceptions import InvalidHandle, InvalidServiceNameException, InvalidTopicNameException
from bus_ros.rclpy.guard_condition import GuardCondition
from bus_ros.rclpy.publisher import Publisher
from bus_ros.rclpy.qos import QoSProfile, profile_of, qos_profile_services_default, to_native
from bus_ros.rclpy.service import Service
from bus_ros.rclpy.subscription import Subscription
from bus_ros.rclpy.timer import Rate, Timer
from bus_ros.rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from bus_ros.rclpy.validate_topic_name import validate_topic_name

if TYPE_CHECKING:  # most programs need neither
    from bus_ros.rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

__all__ = ["EntityMaker"]

M = TypeVar("M")
E = TypeVar("E", bound=Entity)


class EntityMaker:
    """Base of Node."""

    def __init__(self, engine: Engine, native: NativeNode, context: Context, clock: Clock) -> None:
        self._engine = engine
        self._native = native
        self._context = context
        self._clock = clock
        self._is_destroyed = False
        self._default_callback_group = MutuallyExclusiveCallbackGroup()
        self._rate_group = ReentrantCallbackGroup()
        self._events = Calls(self, self._default_callback_group)
        self._entities: tuple[Entity, ...] = (self._events,)
        self._publishers: tuple[Publisher[Any], ...] = ()
        self.timers: tuple[Timer, ...] = ()
        self.own_executor: Any = None
        """The executor that works for this node."""

    @property
    def default_callback_group(self) -> CallbackGroup:
        """What excludes the callbacks of a node from one another, where they name no group."""
        return self._default_callback_group

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        return iter(self._publishers)

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        return (one for one in self._entities if isinstance(one, Subscription))

    @property
    def clients(self) -> Iterator[Client]:
        return (one for one in self._entities if isinstance(one, Client))

    @property
    def services(self) -> Iterator[Service]:
        return (one for one in self._entities if isinstance(one, Service))

    @property
    def guards(self) -> Iterator[GuardCondition]:
        return (one for one in self._entities if isinstance(one, GuardCondition))

    def entities(self) -> Iterable[Entity]:
        """All that may have calls to make, but the timers."""
        return self._entities

    # --- making

    def create_publisher(
        self,
        msg_type: type[M],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: "PublisherEventCallbacks | None" = None,
        qos_overriding_options: Any = None,
        publisher_class: Any = None,
    ) -> Publisher[M]:
        """A publisher; an int as `qos_profile` is keep last with that depth."""
        check_is_valid_msg_type(msg_type)
        self._check(topic)
        profile = self._profile("publisher", topic, qos_profile, qos_overriding_options)
        native = self._engine.run(
            lambda: self._native.create_publisher(
                msg_type,  # type: ignore[type-var]
                topic,
                to_native(profile, for_publisher=True),
                events=self._publisher_events(event_callbacks),
            )
        )
        publisher = Publisher(self._engine, native, msg_type, profile, self)
        with self._engine.loop:
            self._publishers = (*self._publishers, publisher)
        return publisher

    def create_subscription(
        self,
        msg_type: type[M],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: "SubscriptionEventCallbacks | None" = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
        content_filter_options: Any = None,
    ) -> Subscription[M]:
        """A subscription; `callback` is `def` or `async def`, of (message) or (message, info)."""
        check_is_valid_msg_type(msg_type)
        _check_callback(callback)
        _check_arguments(callback)
        if content_filter_options is not None:
            raise NotImplementedError("content filters are not there yet: filter in the callback")
        self._check(topic)
        profile = self._profile("subscription", topic, qos_profile, qos_overriding_options)
        native = self._engine.run(
            lambda: self._native.create_subscription(
                msg_type,  # type: ignore[type-var]
                topic,
                to_native(profile),
                events=self._subscription_events(event_callbacks),
                raw=raw,
            )
        )
        group = callback_group or self._default_callback_group
        return self._add(Subscription(self._engine, native, msg_type, callback, group, profile, raw, self))

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """A client of a service."""
        check_is_valid_srv_type(srv_type)
        self._check(srv_name, is_service=True)
        profile = profile_of(qos_profile)
        group = callback_group or self._default_callback_group
        client = Client(self._engine, srv_type, srv_name, profile, group, self)
        client.native = self._engine.run(
            lambda: self._native.create_client(
                srv_type, srv_name, _service_qos(profile), on_response=client.on_response
            )
        )
        return self._add(client)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Serve; `callback(request, response)`, `def` or `async def`, returns the response."""
        check_is_valid_srv_type(srv_type)
        self._check(srv_name, is_service=True)
        _check_callback(callback)
        profile = profile_of(qos_profile)
        group = callback_group or self._default_callback_group
        service = Service(self._engine, srv_type, srv_name, callback, group, profile, self)
        service.native = self._engine.run(
            lambda: self._native.create_service(
                srv_type, srv_name, qos=_service_qos(profile), on_request=service.on_request
            )
        )
        return self._add(service)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call `callback()` every `timer_period_sec` seconds, the first time after one period."""
        period_ns = int(float(timer_period_sec) * 1e9)
        if period_ns < 0:
            raise ValueError(f"timer period {timer_period_sec!r} is below zero")
        if callback is not None:
            _check_callback(callback)
        group = callback_group or self._default_callback_group
        timer = Timer(callback, group, period_ns, clock or self._clock, node=self, autostart=autostart)
        with self._engine.loop:
            self.timers = (*self.timers, timer)
            timer.rearm()
        return timer

    def create_guard_condition(
        self, callback: Callable[[], object], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """A callback that `trigger` has called by the executor."""
        return self._add(GuardCondition(callback, callback_group or self._default_callback_group, self))

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """For loops that are to run `frequency` times a second."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        # In a group of its own, so that other callbacks do not move it.
        timer = self.create_timer(1 / frequency, None, self._rate_group, clock)
        return Rate(timer, context=self._context)

    # --- destroying

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Returns whether it was this node's."""
        with self._engine.loop:
            is_ours = publisher in self._publishers
            self._publishers = tuple(one for one in self._publishers if one is not publisher)
        if is_ours:
            self._engine.run(publisher.native.close)
        return is_ours

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        return self._remove(subscription, subscription.native)

    def destroy_client(self, client: Client) -> bool:
        return self._remove(client, client.native)

    def destroy_service(self, service: Service) -> bool:
        return self._remove(service, service.native)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self._remove(guard, None)

    def destroy_timer(self, timer: Timer) -> bool:
        with self._engine.loop:
            is_ours = timer in self.timers
            timer.is_destroyed = True
            timer.forget_clock()
            self.timers = tuple(one for one in self.timers if one is not timer)
        return is_ours

    def destroy_rate(self, rate: Rate) -> bool:
        is_ours = self.destroy_timer(rate._timer)
        rate.destroy()
        return is_ours

    # --- inside

    def _check(self, name: str, *, is_service: bool = False) -> None:
        """Before something of that name is made. Raises InvalidHandle where the node is destroyed."""
        if self._is_destroyed:
            raise InvalidHandle(f"node '{self._native.full_name}' is destroyed")
        validate_topic_name(name, is_service=is_service)
        try:
            self._native.resolve_topic_name(name)
        except ConfigurationError as error:  # what is wrong only with the full name
            kind = InvalidServiceNameException if is_service else InvalidTopicNameException
            raise kind.of(name, error) from None

    def _profile(self, kind: Any, topic: str, profile: QoSProfile | int, options: Any) -> QoSProfile:
        profile = copy(profile_of(profile))
        if options is not None:
            from bus_ros.rclpy.qos_overriding_options import declare_qos_parameters

            declare_qos_parameters(kind, self, self._native.resolve_topic_name(topic), profile, options)  # type: ignore[arg-type]
        return profile

    def _publisher_events(self, callbacks: "PublisherEventCallbacks | None") -> PublisherEvents | None:
        if callbacks is None:
            return None  # the bus warns of what is incompatible
        from bus_ros.rclpy.event_handler import publisher_events

        return publisher_events(callbacks, self._events.put)

    def _subscription_events(
        self, callbacks: "SubscriptionEventCallbacks | None"
    ) -> SubscriptionEvents | None:
        if callbacks is None:
            return None
        from bus_ros.rclpy.event_handler import subscription_events

        return subscription_events(callbacks, self._events.put)

    def _add(self, entity: E) -> E:
        with self._engine.loop:
            self._entities = (*self._entities, entity)
            entity.notify()
        return entity

    def _remove(self, entity: Entity, native: Any) -> bool:
        with self._engine.loop:
            is_ours = entity in self._entities
            entity.is_destroyed = True
            entity.leave()
            self._entities = tuple(one for one in self._entities if one is not entity)
        if is_ours and native is not None:
            self._engine.run(native.close)
        return is_ours

    def _forget_all(self) -> None:
        with self._engine.loop:
            for entity in (*self._entities, *self.timers):
                entity.is_destroyed = True
            for timer in self.timers:
                timer.forget_clock()
            self.timers, self._entities, self._publishers = (), (), ()


def _check_callback(callback: object) -> None:
    if not callable(callback):
        raise TypeError(f"callback must be callable, not {type(callback).__name__}")


def _check_arguments(callback: Callable[..., object]) -> None:
    """Of a subscription's callback. Raises RuntimeError, with rclpy's text."""
    try:
        taken = signature(callback)
    except (TypeError, ValueError):  # some that are written in C have none
        return
    for given in ((None,), (None, None)):
        with suppress(TypeError):
            taken.bind(*given)
            return
    raise RuntimeError(
        "Subscription.__init__(): callback should be either be callable with one argument"
        "(to get only the message) or two (to get message and message info)"
    )


def _service_qos(profile: QoSProfile) -> NativeProfile:
    """With ROS's default depth of 10, a burst of calls would lose some without a word."""
    return SERVICE_QOS if profile == qos_profile_services_default else to_native(profile)

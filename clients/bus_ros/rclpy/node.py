"""Nodes: a native node on the engine's loop, which makes and destroys publishers and entities.

Owns the lists of a node's entities, and its beginning and end. `impl.base_node` has the part that AsyncNode
shares. Private names are mangled, except names that rclpy has too: a program's own nodes may use any other.
"""

from collections.abc import Callable, Coroutine, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar
from weakref import ref

from bus.base.together import together
from bus.errors import BusError
from bus.graph import Graph
from bus.node import Node as NativeNode
from bus.qos import QoSProfile as NativeProfile
from bus_ros.engine import current, engine
from bus_ros.entity import Entity
from bus_ros.rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from bus_ros.rclpy.client import Client
from bus_ros.rclpy.clock import Clock, ROSClock
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.duration import S_TO_NS
from bus_ros.rclpy.exceptions import (
    InvalidHandle,
    NodeNameNonExistentError,
    RCLError,
)
from bus_ros.rclpy.guard_condition import GuardCondition
from bus_ros.rclpy.impl.base_node import BaseNode, NativeParts
from bus_ros.rclpy.impl.callback_checks import check_arguments, check_callback
from bus_ros.rclpy.impl.native_node import service_qos
from bus_ros.rclpy.impl.node_waitables import NodeWaitables
from bus_ros.rclpy.impl.own_services import OwnServices
from bus_ros.rclpy.parameter import PARAMETER_SEPARATOR_STRING, Parameter
from bus_ros.rclpy.publisher import Publisher
from bus_ros.rclpy.qos import (
    QoSProfile,
    profile_of,
    qos_profile_services_default,
    to_native,
)
from bus_ros.rclpy.service import Service
from bus_ros.rclpy.subscription import Subscription
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions
from bus_ros.rclpy.time_source import TimeSource
from bus_ros.rclpy.timer import Rate, Timer
from bus_ros.rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from bus_ros.rclpy.validate_topic_name import full_name, validate_topic_name

if TYPE_CHECKING:  # most programs need none
    from bus_ros.rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
    from bus_ros.rclpy.executors import Executor
    from bus_ros.rclpy.impl.endpoint_events import EndpointEvents
    from bus_ros.rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = [
    "HIDDEN_NODE_PREFIX",
    "PARAMETER_SEPARATOR_STRING",
    "S_TO_NS",
    "BaseNode",
    "Node",
    "NodeNameNonExistentError",
]

HIDDEN_NODE_PREFIX = "_"

M = TypeVar("M")
E = TypeVar("E", bound=Entity)

CLOSE_S = 6.0
"""The longest time that `destroy_node` waits until publications have left the process."""


class Closable(Protocol):
    """The library's object behind an entity."""

    async def close(self) -> None: ...


class Node(BaseNode, NodeWaitables):
    """A node named `node_name`; in the graph at once, until `destroy_node` or the end of the process.

    Its publishers work without spinning. ROS arguments in `cli_args` (after --ros-args) are for this node,
    and override the program's own.

    Raises NotInitializedException before `rclpy.init`, InvalidNodeNameException, InvalidNamespaceException,
    RCLInvalidROSArgsError or UnknownROSArgsError for `cli_args`, and BrokerUnavailable if no busd answers and
    none could be started.
    """

    PARAM_REL_TOL = 1e-6

    def __init__(  # noqa: PLR0913
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: Sequence[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int | None = None,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        parts = NativeParts(
            node_name,
            namespace,
            context,
            cli_args,
            use_global_arguments=use_global_arguments,
            enable_rosout=enable_rosout,
        )
        self.__engine = engine()
        self.__native = native = parts.node
        self.__is_destroyed = False
        NodeWaitables.__init__(self, self.__add, lambda entity: self.__remove(entity, None))
        self._default_callback_group = MutuallyExclusiveCallbackGroup()
        self._rate_group = ReentrantCallbackGroup()
        self.__entities: tuple[Entity, ...] = ()
        self.__events: dict[Closable, Entity] = {}
        self.__publishers: tuple[Publisher[Any], ...] = ()
        self.__unopened: list[Service] | None = None
        self.timers: tuple[Timer, ...] = ()
        self.own_executor: Executor | None = None
        """The executor that works for this node."""
        self.last_executor: ref[Executor] | None = None
        self._clock = ROSClock()
        own_services = OwnServices(self)
        BaseNode.__init__(
            self,
            parts,
            Handle(lambda: self.__is_destroyed, self.destroy_node, self),
            lambda: self.__engine.run(native.graph),
            own_services.publish_change,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
        )
        self.__engine.run(native.open)
        self._context.track_node(self)
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        own_services.start(has_parameters=start_parameter_services, at_once=self.__at_once())
        if enable_logger_service:
            from bus_ros.rclpy.logging_service import LoggingService  # late: few nodes have it

            LoggingService(self)

    if not TYPE_CHECKING:  # with it, a type checker would accept any attribute of a node

        def __getattr__(self, name: str) -> Any:
            from bus_ros.rclpy.impl.private_names import look_up  # late: few programs ask

            return look_up(self, name)

    # --- properties

    @property
    def executor(self) -> "Executor | None":
        """The last executor that worked for this node; setting it removes the node from the previous one."""
        return self.last_executor() if self.last_executor is not None else None

    @executor.setter
    def executor(self, new: "Executor | None") -> None:
        current, self.last_executor = self.executor, None if new is None else ref(new)
        if current is not new and current is not None:
            current.remove_node(self)
        if current is not new and new is not None:
            new.add_node(self)

    def get_clock(self) -> Clock:
        """The clock that follows the parameter use_sim_time."""
        return self._clock

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group for callbacks without one: one at a time."""
        return self._default_callback_group

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        return iter(self.__publishers)

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        return (one for one in self.__entities if isinstance(one, Subscription))

    @property
    def clients(self) -> Iterator[Client]:
        return (one for one in self.__entities if isinstance(one, Client))

    @property
    def services(self) -> Iterator[Service]:
        return (one for one in self.__entities if isinstance(one, Service))

    @property
    def guards(self) -> Iterator[GuardCondition]:
        return (one for one in self.__entities if isinstance(one, GuardCondition))

    def own_entities(self) -> Iterable[Entity]:
        """All entities that may have calls to make, except the timers."""
        return self.__entities

    # --- making

    def create_publisher(
        self,
        msg_type: type[M],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: "PublisherEventCallbacks | None" = None,
        qos_overriding_options: "QoSOverridingOptions | None" = None,
        publisher_class: type[Publisher[Any]] | None = None,
    ) -> Publisher[M]:
        """Make a publisher; an int as `qos_profile` is keep last with that depth.

        `publisher_class` is a subclass of Publisher, which is made with the same arguments.
        """
        check_is_valid_msg_type(msg_type)
        self.__check(topic)
        profile = self.__profile("publisher", topic, qos_profile, qos_overriding_options)
        events = self.__make_events(event_callbacks, "publisher", callback_group)
        native = self.__engine.run(
            lambda: self.__native.create_publisher(
                msg_type,  # type: ignore[type-var]
                topic,
                to_native(profile, for_publisher=True),
                events=None if events is None else events.native,
            )
        )
        self.__add_events(events, native)
        make: Any = publisher_class or Publisher
        publisher: Publisher[M] = make(self.__engine, native, msg_type, profile, self)
        publisher.event_callbacks = event_callbacks
        publisher._event_group = callback_group
        with self.__engine.loop:
            self.__publishers = (*self.__publishers, publisher)
        return publisher

    def create_subscription(  # noqa: PLR0913
        self,
        msg_type: type[M],
        topic: str,
        callback: Callable[..., object],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: "SubscriptionEventCallbacks | None" = None,
        qos_overriding_options: "QoSOverridingOptions | None" = None,
        raw: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> Subscription[M]:
        """Make a subscription; `callback` is `def` or `async def`, with (message) or (message, info).

        `content_filter_options` selects messages; raises RCLError for an invalid expression.
        """
        check_is_valid_msg_type(msg_type)
        check_callback(callback)
        check_arguments(callback)
        self.__check(topic)
        profile = self.__profile("subscription", topic, qos_profile, qos_overriding_options)
        events = self.__make_events(event_callbacks, "subscription", callback_group)
        native = self.__engine.run(
            lambda: self.__native.create_subscription(
                msg_type, topic, to_native(profile), events=None if events is None else events.native, raw=raw
            )
        )
        self.__add_events(events, native)
        group = callback_group or self._default_callback_group
        made = Subscription(self.__engine, native, msg_type, callback, group, profile, raw, self)
        made.event_callbacks = event_callbacks
        if content_filter_options is not None:
            try:
                made.set_content_filter(*content_filter_options)
            except RCLError:
                self.__end_events(native)
                self.__engine.run(native.close)
                raise
        return self.__add(made)

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Make a client of a service."""
        check_is_valid_srv_type(srv_type)
        self.__check(srv_name, is_service=True)
        profile = profile_of(qos_profile)
        group = callback_group or self._default_callback_group
        client = Client(self.__engine, srv_type, srv_name, profile, group, self)
        client.native = self.__engine.run(
            lambda: self.__native.create_client(
                srv_type, srv_name, service_qos(profile), on_response=client.on_response
            )
        )
        return self.__add(client)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Serve a service; `callback(request, response)`, `def` or `async def`, returns the response."""
        check_is_valid_srv_type(srv_type)
        self.__check(srv_name, is_service=True)
        check_callback(callback)
        profile = profile_of(qos_profile)
        group = callback_group or self._default_callback_group
        service = Service(self.__engine, srv_type, srv_name, callback, group, profile, self)
        if self.__unopened is None:
            self.__open([service])
        else:
            self.__unopened.append(service)
        return service

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., object] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call `callback` every `timer_period_sec` seconds, the first time after one period.

        A callback gets a TimerInfo if it needs an argument, or has a parameter with this annotation.
        """
        period_ns = int(float(timer_period_sec) * 1e9)
        if period_ns < 0:
            raise RCLError("failed to create timer: timer period must be non-negative")
        if callback is not None:
            check_callback(callback)
        group = callback_group or self._default_callback_group
        timer = Timer(callback, group, period_ns, clock or self._clock, node=self, autostart=autostart)
        with self.__engine.loop:
            self.timers = (*self.timers, timer)
            timer.rearm()
        return timer

    def create_guard_condition(
        self, callback: Callable[[], object], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Make a guard condition: its `trigger` makes the executor call `callback`."""
        return self.__add(GuardCondition(callback, callback_group or self._default_callback_group, self))

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """A rate for loops that run `frequency` times a second."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        # In a separate group: other callbacks must not delay it.
        timer = self.create_timer(1 / frequency, None, self._rate_group, clock)
        return Rate(timer, context=self._context)

    def _host_entity(self, entity: E, open_natives: Callable[[NativeNode], Coroutine[Any, Any, None]]) -> E:
        """Open the endpoints of an entity that has several, and let executors work for `entity`."""
        self.handle.check()
        self.__engine.run(lambda: open_natives(self.__native))
        entity.is_queued = False
        return self.__add(entity)

    # --- destroying: an entity of another node stays as it is, and they return False

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Destroy a publisher; returns whether it belonged to this node."""
        with self.__engine.loop:
            is_ours = publisher in self.__publishers
            self.__publishers = tuple(one for one in self.__publishers if one is not publisher)
        if is_ours:
            self.__end_events(publisher.native)
            self.__engine.run(publisher.native.close)
        return is_ours

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        self.__end_events(subscription.native)
        return self.__remove(subscription, subscription.native)

    def destroy_client(self, client: Client) -> bool:
        if is_ours := self.__remove(client, client.native):
            client.forget_events()
        return is_ours

    def destroy_service(self, service: Service) -> bool:
        if is_ours := self.__remove(service, service.native):
            service.forget_events()
        return is_ours

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self.__remove(guard, None)

    def destroy_timer(self, timer: Timer) -> bool:
        with self.__engine.loop:
            if timer not in self.timers:
                return False
            timer.is_destroyed = True
            timer.forget_clock()
            self.timers = tuple(one for one in self.timers if one is not timer)
        return True

    def destroy_rate(self, rate: Rate) -> bool:
        if is_ours := self.destroy_timer(rate._timer):
            rate.destroy()
        return is_ours

    def _evict_entity(self, entity: Entity, natives: "Closable") -> bool:
        """Undo `_host_entity`; returns whether the entity belonged to this node."""
        return self.__remove(entity, natives)

    # --- waiting

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait at most `timeout` seconds until such a node is in the graph; returns whether it is."""
        wanted = fully_qualified_node_name
        if not wanted.startswith("/"):
            wanted = f"{self.get_namespace().rstrip('/')}/{wanted}"

        def is_there(graph: Graph) -> bool:
            return any(node.full_name == wanted for node in graph.nodes)

        try:
            self.__engine.run(lambda: self.__native.wait_for_graph(is_there), timeout, context=self._context)
        except TimeoutError:
            return False
        return True

    def receive_one(
        self, msg_type: type[M], topic: str, qos: NativeProfile, timeout_s: float | None
    ) -> tuple[bool, M | None]:
        """Receive one message, for `rclpy.wait_for_message`."""
        engine = self.__engine
        subscription: Any = engine.run(lambda: self.__native.create_subscription(msg_type, topic, qos))
        try:
            return True, engine.run(subscription.receive, timeout_s, context=self.context)[0]
        except TimeoutError:
            return False, None
        finally:
            engine.run(subscription.close)

    # --- ending

    def destroy_node(self) -> None:
        """Hand over published messages and leave the graph. A second call does nothing."""
        if self.__is_destroyed:
            return
        self.__is_destroyed = True
        if self.__engine is not current():
            return  # made before a fork: it belongs to the parent
        if self.own_executor is not None:
            self.own_executor.remove_node(self)
        self.__forget_all()
        try:
            self.__engine.run(self.__native.close, CLOSE_S)
        except (TimeoutError, BusError) as error:
            self._logger.warning(f"not everything could be handed over: {error or 'busd does not take it'}")

    def __enter__(self) -> "Node":
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy_node()

    # --- inside

    @contextmanager
    def __at_once(self) -> Iterator[None]:
        """Services made in the `with` are opened at its end, with one wait for busd."""
        self.__unopened = unopened = list[Service]()
        try:
            yield
        finally:
            self.__unopened = None
        self.__open(unopened)

    def __open(self, services: Sequence[Service]) -> None:
        """Open services; if busd refuses one, the others are opened. Raises the error."""

        async def serve(service: Service) -> BaseException | None:
            try:
                native = await self.__native.create_service(
                    service.srv_type,
                    service.srv_name,
                    qos=service_qos(service.qos_profile),
                    on_request=service.on_request,
                )
            except BusError as error:
                return error
            service.begin(native)
            return None

        errors = self.__engine.run(lambda: together(map(serve, services)))
        for service, error in zip(services, errors, strict=True):
            if error is None:
                self.__add(service)
        for error in filter(None, errors):
            raise error

    def __check(self, name: str, *, is_service: bool = False) -> None:
        """Check a name before an endpoint is made. Raises InvalidHandle if the node is destroyed."""
        if self.__is_destroyed:
            raise InvalidHandle(f"node '{self.__native.full_name}' is destroyed")
        validate_topic_name(name, is_service=is_service)
        full_name(name, self.__native.resolve_topic_name, is_service=is_service)

    def __profile(
        self, kind: str, topic: str, profile: QoSProfile | int, options: "QoSOverridingOptions | None"
    ) -> QoSProfile:
        profile = copy(profile_of(profile))
        if options is not None:
            from bus_ros.rclpy.qos_overriding_options import declare_qos_parameters

            declare_qos_parameters(kind, self, self.__native.resolve_topic_name(topic), profile, options)
        return profile

    def __make_events(
        self, callbacks: object, kind: Literal["publisher", "subscription"], group: CallbackGroup | None
    ) -> "EndpointEvents | None":
        if callbacks is None:
            return None  # the bus warns of incompatible endpoints
        from bus_ros.rclpy.event_handler import publisher_events, subscription_events  # late: few have any
        from bus_ros.rclpy.impl.endpoint_events import EndpointEvents

        translate: Any = publisher_events if kind == "publisher" else subscription_events
        return EndpointEvents(callbacks, translate, self, group or self._default_callback_group)

    def __add_events(self, events: Entity | None, native: "Closable") -> None:
        if events is not None:
            self.__events[native] = self.__add(events)

    def __end_events(self, native: "Closable") -> None:
        if (events := self.__events.pop(native, None)) is not None:
            self.__remove(events, None)

    def __add(self, entity: E) -> E:
        with self.__engine.loop:
            self.__entities = (*self.__entities, entity)
            entity.notify()
        return entity

    def __remove(self, entity: Entity, native: "Closable | None") -> bool:
        with self.__engine.loop:
            if entity not in self.__entities:
                return False
            entity.is_destroyed = True
            entity.leave()
            if entity in self.waiting:
                self.waiting.remove(entity)
            self.__entities = tuple(one for one in self.__entities if one is not entity)
        if native is not None:
            self.__engine.run(native.close)
        return True

    def __forget_all(self) -> None:
        with self.__engine.loop:
            for entity in (*self.__entities, *self.timers):
                entity.is_destroyed = True
            for timer in self.timers:
                timer.forget_clock()
            self.timers, self.__entities, self.__publishers = (), (), ()

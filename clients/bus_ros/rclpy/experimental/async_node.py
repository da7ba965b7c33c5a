"""Nodes on asyncio's event loop: a native node, and the task group of its callbacks.

Owns the node's entities, its life, and the end of its `async with` block. The life has the states of an
endpoint's life: `impl.async_entity` has the table. Private names are mangled, as in `rclpy.node`.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from signal import SIGINT
from threading import current_thread, main_thread
from types import TracebackType
from typing import Any, Self, TypeVar

from bus_ros.rclpy import signals
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import InvalidHandle, RCLError
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.experimental.async_action import AsyncActionClient, AsyncActionServer
from bus_ros.rclpy.experimental.async_client import AsyncClient
from bus_ros.rclpy.experimental.async_clock import AsyncClock
from bus_ros.rclpy.experimental.async_publisher import AsyncPublisher
from bus_ros.rclpy.experimental.async_service import AsyncService
from bus_ros.rclpy.experimental.async_subscription import AsyncSubscription
from bus_ros.rclpy.experimental.async_timer import AsyncTimer
from bus_ros.rclpy.impl.async_entity import TRANSITIONS, AsyncEntity, EntityEvent, EntityState
from bus_ros.rclpy.impl.async_graph import read_graph
from bus_ros.rclpy.impl.async_work import AsyncWork
from bus_ros.rclpy.impl.base_node import BaseNode, NativeParts
from bus_ros.rclpy.impl.callback_checks import check_arguments, check_callback
from bus_ros.rclpy.impl.own_services import OwnServices
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.qos import QoSProfile, profile_of, qos_profile_services_default
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions
from bus_ros.rclpy.time_source import TimeSource
from bus_ros.rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from bus_ros.rclpy.validate_topic_name import full_name, validate_topic_name

__all__ = ["AsyncNode"]

M = TypeVar("M")
E = TypeVar("E", bound=AsyncEntity)


class AsyncNode(BaseNode):
    """A node whose callbacks run on asyncio's event loop, without an executor.

    It lives as long as an `async with` block, or `await node.run()`. Publishers, subscriptions, services,
    clients and timers can be made before, for example in the constructor of a subclass, and meanwhile.
    Callbacks are `def` or `async def`.

    An exception in a callback ends the node: it cancels the block, which then raises an ExceptionGroup, as
    `asyncio.TaskGroup` does. If `rclpy.shutdown` or SIGTERM ends the context meanwhile, the block is
    cancelled and raises ExternalShutdownException; so does a block that begins later.

    Not thread-safe, except `publish`. Raises as `Node`; BrokerUnavailable on entering the block.

        async with AsyncNode("listener") as node:
            node.create_subscription(String, "chatter", print, 10)
            await asyncio.sleep(10)
    """

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
            on_error=lambda error: self.__work.fail(error),
        )
        self.__native = parts.node
        self.__work = work = AsyncWork(self, parts.node)
        self.__state = EntityState.MADE
        self.__shutdown: _Shutdown | None = None
        self.__destroyed = asyncio.Event()
        self._clock = AsyncClock()
        own_services = OwnServices(self)
        BaseNode.__init__(
            self,
            parts,
            Handle(lambda: self.__state is EntityState.DESTROYED, self.destroy_node, self),
            lambda: read_graph(self.__native, work.entities),
            own_services.publish_change,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
        )
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        work.is_optional = True
        own_services.start(has_parameters=start_parameter_services)
        if enable_logger_service:
            from bus_ros.rclpy.logging_service import LoggingService  # late: few nodes have it

            LoggingService(self)
        work.is_optional = False

    # --- its life

    async def __aenter__(self) -> Self:
        if self.__state is EntityState.DESTROYED:
            raise RuntimeError(f"node '{self.get_fully_qualified_name()}' is destroyed and can't run again")
        if self.__state is not EntityState.MADE:
            raise RuntimeError(f"node '{self.get_fully_qualified_name()}' runs already")
        self.__advance(EntityEvent.BEGIN)
        self.__work.attach()
        self.__shutdown = shutdown = _Shutdown(self.context)
        try:
            await shutdown.check()
            await self.__native.open()
        except BaseException as error:
            self.destroy_node()
            shutdown.is_over = True
            if isinstance(error, asyncio.CancelledError) and shutdown.has_cancelled_alone():
                raise ExternalShutdownException from None
            raise
        if self.__advance(EntityEvent.OPENED) is EntityState.DESTROYED:  # by another task, meanwhile
            self.__work.run_behind(self.__native.close())
        try:
            await self.__work.begin()
        except BaseException as error:
            await self.__aexit__(type(error), error, error.__traceback__)
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutdown = self.__shutdown
        assert shutdown is not None
        if error is None:
            try:
                await self.__work.finish_openings()
            except BaseException as late:
                kind, error, trace = type(late), late, late.__traceback__
        self.destroy_node()
        try:
            await self.__work.end(kind, error, trace)
        except asyncio.CancelledError:
            if not shutdown.has_cancelled_alone():
                raise
        finally:
            shutdown.is_over = True
        if shutdown.has_come and isinstance(error, asyncio.CancelledError):
            raise ExternalShutdownException

    async def run(self) -> None:
        """Run the node until `destroy_node`, or until this is cancelled; instead of `async with`.

        Raises RuntimeError if it runs already or is destroyed; otherwise as the `async with` block.
        """
        async with self:
            await self.__destroyed.wait()

    def destroy_node(self) -> None:
        """Stop all callbacks and leave the graph; `run` returns. A second call does nothing.

        Published messages are handed over at the end of the `async with` block, or of `run`.
        """
        before = self.__state
        if before is EntityState.DESTROYED:
            return
        self.__advance(EntityEvent.DESTROY)
        for entity in tuple(self.__work.entities):
            entity.destroy()
        self._time_source.detach_node()
        self._clock.destroy()
        self.__destroyed.set()
        if before is EntityState.OPEN:
            self.__work.run_behind(self.__native.close())

    # --- what it has

    def get_clock(self) -> AsyncClock:
        """The clock that follows the parameter use_sim_time."""
        return self._clock

    @property
    def publishers(self) -> Iterator[AsyncPublisher[Any]]:
        return (one for one in tuple(self.__work.entities) if isinstance(one, AsyncPublisher))

    @property
    def subscriptions(self) -> Iterator[AsyncSubscription[Any]]:
        return (one for one in tuple(self.__work.entities) if isinstance(one, AsyncSubscription))

    @property
    def services(self) -> Iterator[AsyncService]:
        return (one for one in tuple(self.__work.entities) if isinstance(one, AsyncService))

    @property
    def clients(self) -> Iterator[AsyncClient]:
        return (one for one in tuple(self.__work.entities) if isinstance(one, AsyncClient))

    @property
    def timers(self) -> Iterator[AsyncTimer]:
        return (one for one in tuple(self.__work.entities) if isinstance(one, AsyncTimer))

    async def wait_for_node(self, fully_qualified_node_name: str, *, check_interval: float = 0.1) -> None:
        """Wait until such a node is in the graph. Has no time limit: use `asyncio.timeout`.

        `check_interval` is ROS 2's, without effect: a change of the graph wakes it at once.
        """
        name = f"/{fully_qualified_node_name.lstrip('/')}"
        await self.__native.wait_for_graph(lambda graph: any(node.full_name == name for node in graph.nodes))

    # --- making

    def create_publisher(
        self,
        msg_type: type[M],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        publisher_class: type[AsyncPublisher[Any]] | None = None,
    ) -> AsyncPublisher[M]:
        """Make a publisher; an int as `qos_profile` is keep last with that depth.

        `publisher_class` is a subclass of AsyncPublisher, which is made with the same arguments. Raises
        InvalidTopicNameException, InvalidHandle after `destroy_node`. If busd refuses it, the node ends with
        the error.
        """
        check_is_valid_msg_type(msg_type)
        name = self.__full_name("publisher", topic)
        make: type[AsyncPublisher[M]] = publisher_class or AsyncPublisher
        return self.__add(make(self.__work, msg_type, name, profile_of(qos_profile)))

    def create_subscription(
        self,
        msg_type: type[M],
        topic: str,
        callback: Callable[..., object] | None,
        qos_profile: QoSProfile | int,
        *,
        raw: bool = False,
        concurrent: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
        callback_group: object = None,
    ) -> AsyncSubscription[M]:
        """Make a subscription; `callback` is `def` or `async def`, with (message) or (message, info).

        Calls of an `async def` come one after the other, or with `concurrent` each in its own task.
        Without a callback (not in ROS 2), iterate: `async for message in subscription`.
        `content_filter_options` selects messages. `callback_group` has no effect. Raises as
        `create_publisher`, and RCLError for an invalid expression.
        """
        check_is_valid_msg_type(msg_type)
        if callback is not None:
            check_callback(callback)
            check_arguments(callback)
        name = self.__full_name("subscription", topic)
        made: AsyncSubscription[M] = AsyncSubscription(
            self.__work, msg_type, name, callback, profile_of(qos_profile), raw=raw, concurrent=concurrent
        )
        if content_filter_options is not None:
            made.set_content_filter(*content_filter_options)
        return self.__add(made)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
        concurrent: bool = False,
        callback_group: object = None,
    ) -> AsyncService:
        """Serve a service; `callback(request, response)`, `def` or `async def`, returns the response.

        An `async def` answers one request after the other, or with `concurrent` each in its own task.
        `callback_group` has no effect. Raises as `create_publisher`.
        """
        check_is_valid_srv_type(srv_type)
        check_callback(callback)
        name = self.__full_name("service", srv_name, is_service=True)
        service = AsyncService(
            self.__work, srv_type, srv_name, name, callback, profile_of(qos_profile), concurrent=concurrent
        )
        return self.__add(service)

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile | int = qos_profile_services_default,
    ) -> AsyncClient:
        """Make a client of a service. Raises as `create_publisher`."""
        check_is_valid_srv_type(srv_type)
        name = self.__full_name("client", srv_name, is_service=True)
        return self.__add(AsyncClient(self.__work, srv_type, srv_name, name, profile_of(qos_profile)))

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any],
        *,
        clock: AsyncClock | None = None,
        autostart: bool = True,
    ) -> AsyncTimer:
        """Call `callback`, with a TimerInfo if it takes an argument, every `timer_period_sec` seconds.

        The first call comes after one period. Raises RCLError for a negative period, InvalidHandle after
        `destroy_node`.
        """
        period_ns = int(float(timer_period_sec) * 1e9)
        if period_ns < 0:
            raise RCLError("failed to create timer: timer period must be non-negative")
        check_callback(callback)
        self.__check("timer")
        return self.__add(
            AsyncTimer(self.__work, period_ns, callback, clock or self._clock, autostart=autostart)
        )

    def create_action_server(
        self,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[..., Any],
        *,
        goal_callback: Callable[[Any], Any] | None = None,
        cancel_callback: Callable[[Any], Any] | None = None,
        result_timeout: float = 900.0,
    ) -> AsyncActionServer:
        """Serve an action; not in ROS 2's AsyncNode.

        `execute_callback(goal_handle)` is an `async def` that returns the Result, or an async generator that
        yields Feedback and at its end the Result. A goal that ends so has succeeded, unless the callback has
        called `goal_handle.abort()` or `canceled()`. A cancellation raises CancelledError in it, at an
        `await`. Each goal runs in its own task. `goal_callback(goal)` and `cancel_callback(goal_handle)`
        return a GoalResponse, a CancelResponse or a bool; by default all is accepted. Raises as
        `create_publisher`. See `bus_actions.ActionServer`.
        """
        check_callback(execute_callback)
        full_name = self.__full_name("action server", action_name)
        server = AsyncActionServer(
            self.__work,
            action_type,
            action_name,
            full_name,
            execute_callback,
            goal_callback=goal_callback,
            cancel_callback=cancel_callback,
            result_timeout=result_timeout,
        )
        return self.__add(server)

    def create_action_client(self, action_type: Any, action_name: str) -> AsyncActionClient:
        """Make a client of an action; not in ROS 2's AsyncNode. Raises as `create_publisher`."""
        full_name = self.__full_name("action client", action_name)
        return self.__add(AsyncActionClient(self.__work, action_type, action_name, full_name))

    # --- destroying: each returns whether the entity belonged to this node

    def destroy_publisher(self, publisher: AsyncPublisher[Any]) -> bool:
        """Destroy a publisher; so do the other four. Returns whether it belonged to this node."""
        return self.__destroy(publisher)

    def destroy_subscription(self, subscription: AsyncSubscription[Any]) -> bool:
        return self.__destroy(subscription)

    def destroy_service(self, service: AsyncService) -> bool:
        return self.__destroy(service)

    def destroy_client(self, client: AsyncClient) -> bool:
        return self.__destroy(client)

    def destroy_timer(self, timer: AsyncTimer) -> bool:
        return self.__destroy(timer)

    # --- inside

    def __advance(self, event: EntityEvent) -> EntityState:
        self.__state = TRANSITIONS[self.__state][event]
        return self.__state

    def __check(self, what: str) -> None:
        if self.__state is EntityState.DESTROYED:
            name = self.get_fully_qualified_name()
            raise InvalidHandle(f"cannot create a {what}: node '{name}' is destroyed")

    def __full_name(self, what: str, name: str, *, is_service: bool = False) -> str:
        self.__check(what)
        validate_topic_name(name, is_service=is_service)
        return full_name(name, self.__native.resolve_topic_name, is_service=is_service)

    def __add(self, entity: E) -> E:
        self.__work.add(entity)
        return entity

    def __destroy(self, entity: AsyncEntity) -> bool:
        is_ours = entity in self.__work.entities
        if is_ours:
            entity.destroy()
        return is_ours


class _Shutdown:
    """The end of a context while a node runs: it cancels the task that made this object, the node's body."""

    def __init__(self, context: Context) -> None:
        self.has_come = False
        self.is_over = False
        """The node has ended: its task may go on, and must not be cancelled."""
        body = asyncio.current_task()
        assert body is not None
        self._body = body
        self._context = context
        context.notify_at_end(self)

    async def check(self) -> None:
        """Raise ExternalShutdownException if the context has ended already."""
        if not self._context.is_valid:
            await asyncio.sleep(0)  # after Ctrl-C, asyncio's cancellation comes here
            raise ExternalShutdownException

    def context_ended(self) -> None:
        """Called in any thread, and in a signal's handler."""
        if not (loop := self._body.get_loop()).is_closed():
            loop.call_soon_threadsafe(self._cancel)

    def has_cancelled_alone(self) -> bool:
        """Take back the cancellation; whether there was no other."""
        return self.has_come and self._body.uncancel() == 0

    def _cancel(self) -> None:
        # In the main thread, asyncio itself, or KeyboardInterrupt, ends the program at Ctrl-C.
        is_interrupted = signals.last_signal() == SIGINT and current_thread() is main_thread()
        if not (self.has_come or self.is_over or is_interrupted):
            self.has_come = True
            self._body.cancel()

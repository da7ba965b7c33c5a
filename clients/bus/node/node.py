"""Nodes: named participants in the graph, owners of publishers, subscriptions and timers."""

from __future__ import annotations

import asyncio
import sys
import weakref
from collections.abc import Callable, Sequence
from os import PathLike
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal, Never, Self, TypeVar, Unpack, overload

import msgspec

from bus import names
from bus.base.awaited import done_anyway, to_be_awaited
from bus.endpoint.core import NodeContext
from bus.endpoint.endpoint import core_of
from bus.errors import BrokerUnavailable, CommandLineError, ConfigurationError, ConnectionClosed, ForkError
from bus.events import PublisherEvents, SubscriptionEvents
from bus.link.declarations import LinkNode
from bus.link.link import Link
from bus.link.shm_context import say_why_slow
from bus.logger import Logger, configure, get_logger
from bus.node import unclosed
from bus.node.endpoints import NodeEndpoints, NodeStatistics
from bus.node.graph_host import GraphHost
from bus.node.rosout import Rosout
from bus.node.unclosed import CloseReminder
from bus.parameters.host import ParameterHost
from bus.parameters.served import ServedParameters
from bus.process.address import socket_name
from bus.process.ros_args import Arguments
from bus.process.start_errors import shown_in_one_line
from bus.publisher import Publisher
from bus.qos import QoS, QoSProfile, profile, rosout_default
from bus.types.support import TypeSupport, type_support

if TYPE_CHECKING:  # not every program needs them
    from bus.graph import Origin
    from bus.schema import MessageSchema
    from bus.service.client import ServiceClient
    from bus.service.server import RequestId, ServiceServer
    from bus.subscription import Bridging, MessageInfo, Subscription
    from bus.timer import Timer

M = TypeVar("M", bound=msgspec.Struct)

# With ROS 2's depth for services, 10, a burst of more calls would lose requests without a message.
SERVICE_QOS: Final = QoSProfile(depth=1000)
"""Default QoS of both ends of a service."""


def _parse(arguments: Sequence[str]) -> Arguments:
    try:
        return Arguments.parse(arguments)
    except ConfigurationError as error:
        raise CommandLineError(str(error)) from None


class Node(ParameterHost, GraphHost):
    """A node named `name` in `namespace`; use it as `async with bus.Node("talker") as node:`.

    - `arguments`: command-line arguments, by default the program's. The node obeys the ones after --ros-args:
      remapping of topics, of the node's name and namespace, parameters, log level.
    - `socket` and `domain` choose the bus, by default as `busd --help` says.
    - `rosout=False` keeps log lines off the topic /rosout.
    - `origin` is for bridges: the node represents a node on another bus.

    An exception in a callback or timer cancels the body of the `async with`, which then raises it.

    Raises ConfigurationError for a wrong name, CommandLineError for wrong `arguments`, StartError for
    BUSD_DOMAIN and the like; on entering, BrokerUnavailable. The last three end a program with one line.

        async with bus.Node("talker", namespace="robot") as node:
            publisher = await node.create_publisher(String, "chatter")
    """

    _must_be_closed = True  # else no warning if the collector finds the node open

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "",
        arguments: Sequence[str] | None = None,
        socket: str | PathLike[str] | None = None,
        domain: int | None = None,
        rosout: bool = True,
        origin: Origin | None = None,
    ) -> None:
        names.validate_node_name(name)
        made_at = unclosed.call_site(self)
        with shown_in_one_line:
            self._arguments = _parse(sys.argv[1:] if arguments is None else arguments)
            self._path = socket_name(socket, domain)
        self.name: str = self._arguments.node_name(name)
        """Its own name, without the namespace, after remapping."""
        self.namespace: str = self._arguments.namespace(names.absolute_namespace(namespace), self.name)
        """Starts with a slash; `/` for none."""
        self._declared = LinkNode(self.name, self.namespace, origin, made_at)
        self._reminder = CloseReminder(self._declared, must_be_closed=self._must_be_closed)
        self._logger = get_logger(names.logger_name(self.namespace, self.name))
        configure(self._arguments)
        with shown_in_one_line:
            given = self._arguments.parameters if self._takes_parameters else ()
            self._served = ServedParameters(self, given)
        self._context: NodeContext  # set when the node is opened
        self._endpoints = NodeEndpoints(self._declared)
        self._timers: weakref.WeakSet[Timer] = weakref.WeakSet()  # the loop keeps a running timer
        self._body: asyncio.Task[Any] | None = None
        self._error: BaseException | None = None
        self._wants_rosout = rosout and self._arguments.log_to_rosout
        self._rosout: Rosout | None = None

    def __repr__(self) -> str:
        state = "not open "
        if self._link is not None:
            failure = self._link.failure
            state = "" if failure is None else f"ended by {type(failure).__name__} "
        publishers, subscriptions = self._endpoints.counts()
        counts = f"publishers={publishers} subscriptions={subscriptions} timers={len(self._timers)}"
        return f"<{type(self).__name__} {state}{self.full_name} {counts}>"

    @property
    def full_name(self) -> str:
        """Namespace and name, as the graph shows them."""
        return self._declared.full_name

    @to_be_awaited
    async def open(self) -> None:
        """Connect to busd, start one if none listens, and appear in the graph; `async with` does it.

        Raises BrokerUnavailable if no busd answers and none could be started, AccessDenied and QuotaExceeded
        as busd's rules say, LocalProtocolError if it is open. After a cancellation the node is not open.
        """
        if self._link is not None or asyncio._get_running_loop() is None:
            from bus.process.mistakes import wrong_open

            raise wrong_open(self.full_name, is_open=self._link is not None)
        with shown_in_one_line:
            await self._open()

    async def _open(self) -> None:
        self._link = await Link.acquire(self._path)
        self._context = NodeContext(self._link, self.full_name, self._logger, self._fail)
        if self._link.shm_context is None and not names.is_hidden_node(self.name):
            say_why_slow()
        try:
            await self._link.declare_node(self._declared)
            if self._wants_rosout:
                await self._open_rosout()
            await self._served.open()
        except BaseException as error:
            await self.close()
            if isinstance(error, TimeoutError):
                raise BrokerUnavailable(str(error)) from None
            raise
        unclosed.warn_of_namesake(self._declared, self._link)

    @done_anyway
    async def close(self) -> None:
        """Stop timers, hand over published messages, close everything the node made, leave the graph.

        If busd does not accept the published messages, this takes at most 5 s; the log says how many were
        lost. Closing twice is allowed. After a cancellation the node is closed; messages not yet handed over
        are lost.
        """
        link, self._link = self._link, None
        if link is None:
            return
        self._end_own_work()
        try:
            if not isinstance(link.failure, ForkError):
                await self._close_endpoints(link)
        finally:
            link.release()

    def __enter__(self) -> Never:
        from bus.process.mistakes import plain_with

        raise plain_with(self.name)

    __exit__ = __enter__  # without one, Python does not get as far as __enter__

    async def __aenter__(self) -> Self:
        await self.open()
        # Perhaps only a task refers to the node, and asyncio itself does not keep tasks.
        self._context.link.hold(self._declared, self)
        self._body = asyncio.current_task()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        body, self._body = self._body, None
        await self.close()
        failure, self._error = self._error, None  # the node may be entered again
        if failure is not None and isinstance(error, asyncio.CancelledError | None):
            if error is not None and body is not None:
                body.uncancel()
            raise failure

    @overload
    async def create_publisher(
        self,
        message_type: type[M],
        topic: str,
        qos: QoS = 10,
        *,
        events: PublisherEvents | None = None,
        gid: bytes | None = None,
    ) -> Publisher[M]: ...

    @overload
    async def create_publisher(
        self,
        message_type: MessageSchema,
        topic: str,
        qos: QoS = 10,
        *,
        events: PublisherEvents | None = None,
        gid: bytes | None = None,
    ) -> Publisher[Any]: ...

    @to_be_awaited
    async def create_publisher(
        self,
        message_type: type[M] | MessageSchema,
        topic: str,
        qos: QoS = 10,
        *,
        events: PublisherEvents | None = None,
        gid: bytes | None = None,
    ) -> Publisher[Any]:
        """Create a publisher of `message_type`, any `msgspec.Struct`, on `topic`.

        `topic` is relative to the node's namespace, private with `~/` in front, or absolute with `/`. An int
        as `qos` means keep last with that depth. `events` are callbacks for its events. With a
        `MessageSchema` instead of a class, messages are published as encoded bytes.

        On return every subscription that existed is matched. After a cancellation the publisher does not
        exist. Raises ConfigurationError (bad name or QoS), MessageTypeError (not a message type),
        QuotaExceeded (busd's limits), AccessDenied (its access rules) and ConnectionClosed (of the node).

        `gid` is for bridges: the gid of the publisher on another bus that this one represents. If this bus
        already has an endpoint with that gid, this raises ConfigurationError.

            publisher = await node.create_publisher(String, "chatter", 10)
        """
        return await self._create_publisher(message_type, topic, qos, events, gid=gid)

    async def _create_publisher(
        self,
        message_type: type[M] | MessageSchema,
        topic: str,
        qos: QoS,
        events: PublisherEvents | None = None,
        *,
        by_socket: bool = False,
        gid: bytes | None = None,
    ) -> Publisher[Any]:
        publisher = self._make_publisher(
            self._opened(), message_type, topic, qos, events, by_socket=by_socket, gid=gid
        )
        await self._endpoints.declare(core_of(publisher))
        return publisher

    def _make_publisher(
        self,
        node: NodeContext,
        message_type: type[M] | MessageSchema,
        topic: str,
        qos: QoS,
        events: PublisherEvents | None = None,
        *,
        by_socket: bool = False,
        gid: bytes | None = None,
    ) -> Publisher[Any]:
        return Publisher(
            node,
            self.resolve_topic_name(topic),
            type_support(message_type) if isinstance(message_type, type) else _schema(message_type, raw=True),
            profile(qos),
            events or PublisherEvents(),
            by_socket=by_socket,
            gid=gid,
        )

    @overload
    async def create_subscription(
        self,
        message_type: type[M],
        topic: str,
        qos: QoS = 10,
        callback: Callable[[M], object] | Callable[[M, MessageInfo], object] | None = None,
        *,
        events: SubscriptionEvents | None = None,
        raw: Literal[False] = False,
        views: bool = False,
        busy_poll: float = 0.0,
        **bridging: Unpack[Bridging],
    ) -> Subscription[M]: ...

    @overload
    async def create_subscription(
        self,
        message_type: type[Any] | MessageSchema | str | None,
        topic: str,
        qos: QoS = 10,
        callback: Callable[[Any], object] | Callable[[Any, MessageInfo], object] | None = None,
        *,
        events: SubscriptionEvents | None = None,
        raw: bool = False,
        views: bool = False,
        busy_poll: float = 0.0,
        **bridging: Unpack[Bridging],
    ) -> Subscription[Any]: ...

    @to_be_awaited
    async def create_subscription(
        self,
        message_type: type[M] | MessageSchema | str | None,
        topic: str,
        qos: QoS = 10,
        callback: Callable[..., object] | None = None,
        *,
        events: SubscriptionEvents | None = None,
        raw: bool = False,
        views: bool = False,
        busy_poll: float = 0.0,
        **bridging: Unpack[Bridging],
    ) -> Subscription[Any]:
        """Create a subscription to `message_type` on `topic`; names, QoS, events as in `create_publisher`.

        - `callback`: `def` or `async def`, of (message) or (message, info). Its calls never overlap. Without
          one, iterate: `async for message in subscription`.
        - `raw`: messages are delivered as the received bytes, undecoded and unchecked.
        - `views`: fields of bytes are read-only views into shared memory, not copies. Each view keeps its
          message there while it exists, for at most seven messages of a publisher; further ones are copied.
        - `busy_poll`: for this many seconds after each message the process polls for the next one without
          sleeping (shared memory only). That saves the wake-up, some microseconds, and costs a whole CPU.

        Instead of a class, `message_type` may be a `MessageSchema`, None for the type of the topic, or the
        name of a type. A name is searched on the topic, then on the bus, then among the types that come with
        busd. If no such type exists yet, this waits for it, without a time limit: use `asyncio.timeout`.
        Messages are then of class `to_class` of the subscription's `schema`, or bytes with `raw`.

        `bridging` is for bridges:

        - `gid`: the gid of the subscription on another bus that this one represents.
        - `local_only=True`: it matches only publishers of nodes without an origin.
        - `role="mirror"`: it is matched, counted, shown and warned of as any subscription. It gets no
          messages here, and no publisher waits for it.
        - `role="tap"`: it takes messages for mirrors, and no count includes it. A reliable + keep-all tap
          matches only publishers with that QoS, any other tap only the other publishers.

        It gets every message whose publishing begins after the return, within its depth. It raises the errors
        of `create_publisher`, and ConfigurationError if the topic has several possible types. After a
        cancellation the subscription does not exist.

            subscription = await node.create_subscription(String, "chatter", 10, print)
            recorded = await node.create_subscription(None, "chatter", 10, print, raw=True)
        """
        from bus.diagnostics.slow_callback import timed_by_caller
        from bus.subscription import Subscription, decoder_of_views

        node, name = self._opened(), self.resolve_topic_name(topic)
        if message_type is None or isinstance(message_type, str):
            message_type = await self._find_schema(name, message_type)
        support = type_support(message_type) if isinstance(message_type, type) else _schema(message_type, raw)
        on_slow: Callable[[int], object] | None = None
        if callback is not None:
            callback, on_slow = timed_by_caller(callback, f"subscription '{name}'", self._logger)
        subscription: Subscription[Any] = Subscription(
            node,
            name,
            support,
            profile(qos),
            events or SubscriptionEvents(),
            callback,
            decode=bytes if raw else decoder_of_views(support) if views else None,
            busy_poll=busy_poll,
            on_slow=on_slow,
            **bridging,
        )
        await self._endpoints.declare(core_of(subscription))
        return subscription

    @to_be_awaited
    async def create_service(
        self,
        service_type: type[Any],
        name: str,
        callback: Callable[..., Any] | None = None,
        qos: QoS = SERVICE_QOS,
        *,
        on_request: Callable[[Any, RequestId], Any] | None = None,
    ) -> ServiceServer:
        """Serve `service_type`, a class as `bus.Service` says, as `name`.

        `callback` is `def` or `async def`. It takes (request) and returns the response, or takes (request,
        response), fills the response and returns it. Up to a hundred calls of an async callback run
        concurrently. An exception goes to the client as ServiceError, and out of the node like one in any
        callback. For `on_request`, instead of a callback, see `ServiceServer`. `qos` is keep last 1000 by
        default. Raises the errors of `create_publisher`, and TypeError for both or neither of `callback` and
        `on_request`. After a cancellation the server does not exist.

            server = await node.create_service(
                AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b)
            )
        """
        from bus.diagnostics.slow_callback import watched
        from bus.service.server import ServiceServer

        node, full_name = self._opened(), self.resolve_service_name(name)
        if callback is not None:
            callback = watched(callback, f"service '{full_name}'", self._logger)
        server = ServiceServer(
            node, full_name, service_type, profile(qos), callback=callback, on_request=on_request
        )
        await self._endpoints.declare(*core_of(server).endpoints)
        return server

    @to_be_awaited
    async def create_client(
        self,
        service_type: type[Any],
        name: str,
        qos: QoS = SERVICE_QOS,
        *,
        on_response: Callable[[int, Any], object] | None = None,
    ) -> ServiceClient:
        """Create a client of the service `name`; on return it knows the existing servers.

        `qos` is keep last 1000 by default. For `on_response` see `ServiceClient`. Raises the errors of
        `create_publisher`. After a cancellation the client does not exist.

            client = await node.create_client(AddTwoInts, "add")
        """
        from bus.service.client import ServiceClient

        client = ServiceClient(
            self._opened(),
            self.resolve_service_name(name),
            service_type,
            profile(qos),
            on_response=on_response,
        )
        await self._endpoints.declare(*core_of(client).endpoints)
        return client

    def create_timer(self, period_s: float, callback: Callable[[], Any]) -> Timer:
        """Call `callback`, `def` or `async def`, without arguments, every `period_s` seconds; see `Timer`.

        Raises ConfigurationError for a period below 0 or above 1e9, ConnectionClosed if the node is not open.

            timer = node.create_timer(0.5, lambda: publisher.publish(String(data="tick")))
        """
        from bus.diagnostics.slow_callback import watched
        from bus.timer import Timer

        self._opened()
        callback = watched(callback, f"timer of {self.full_name}", self._logger)
        timer = Timer(period_s, callback, self._fail, self._served.clock)
        self._timers.add(timer)
        return timer

    def get_logger(self) -> Logger:
        """The logger of this node; it writes ROS 2's log lines to stderr, and to the topic /rosout.

        For example:

            node.get_logger().info("ready")
        """
        return self._logger

    def resolve_topic_name(self, topic: str) -> str:
        """The full name of `topic` in this node, after expansion and remapping.

        Raises ConfigurationError for a bad name.
        """
        full = names.topic_in_node(topic, self.name, self.namespace)
        return self._arguments.topic(full, self.name, self.namespace)

    def resolve_service_name(self, name: str) -> str:
        """The full name of service `name` in this node. Raises ConfigurationError for a bad name."""
        full = names.topic_in_node(name, self.name, self.namespace)
        return self._arguments.service(full, self.name, self.namespace)

    async def spin(self) -> None:
        """Wait for ever while callbacks and timers work; an exception in one ends the `async with`.

        Raises ConnectionClosed if the node is not open. Cancellation is the way to end it.
        """
        self._opened()
        await asyncio.get_running_loop().create_future()

    def statistics(self) -> NodeStatistics:
        """The sums over its open endpoints."""
        return self._endpoints.statistics()

    def __del__(self) -> None:
        if self._link is not None:
            self._reminder.found(self, self._link, self._let_go)

    # --- inside

    def _opened(self) -> NodeContext:
        if self._link is None:
            text = f"node {self.full_name} is not open; use: async with bus.Node(...) as node"
            raise ConnectionClosed(text)
        if self._link.failure is not None:
            raise self._link.failure
        if self._link.guarded_loop is None and self._link.loop is not asyncio._get_running_loop():
            from bus.process.mistakes import other_loop

            raise other_loop(f"node {self.full_name}", self._link.loop)
        return self._context

    def _end_own_work(self) -> None:
        if self._watches is not None:
            self._watches.end()
        for timer in tuple(self._timers):
            timer.close()
        self._served.close()
        if self._rosout is not None:
            self._rosout.close()

    def _let_go(self, link: Link, connection: object) -> None:
        """Close without waiting for busd. `connection`: the connection for which busd's ids are valid."""
        self._link = None
        if link.loop.is_closed():  # its tasks and timers must not be touched, and never run
            if self._rosout is not None:
                self._rosout.close()
            link.release()
            return
        self._reminder.report_dropped()
        link.hand_over()
        self._end_own_work()
        if link.connection_now() is not connection:
            self._declared.id = 0
            self._endpoints.forget_ids()
        self._endpoints.end(ConnectionClosed(f"node {self.full_name} is closed"))
        link.forget_node(self._declared)
        link.release()

    async def _close_endpoints(self, link: Link) -> None:
        try:
            if self._rosout is not None:
                await self._rosout.declared()
            await self._endpoints.close()
        finally:
            self._endpoints.end(ConnectionClosed(f"node {self.full_name} is closed"))
            link.forget_node(self._declared)

    def _fail(self, error: BaseException) -> None:
        """A callback raised an exception: end the body of the `async with`, or report to the event loop
        without one."""
        if self._error is not None:
            return
        if self._body is not None:
            self._error = error
            self._body.cancel()
        else:
            context = {"message": f"exception in a callback of {self.full_name}", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)

    async def _open_rosout(self) -> None:
        from bus.msg.rcl_interfaces import Log

        # Most nodes log little, and busd keeps the history anyway, so a ring is not worth its memory.
        publisher = self._make_publisher(self._context, Log, "/rosout", rosout_default, by_socket=True)
        self._rosout = Rosout(publisher, self._logger)
        await self._rosout.open(self._endpoints.declare)


def _schema(message_type: MessageSchema, raw: bool) -> TypeSupport[Any]:
    """The support of a schema. Raises as `type_support` for anything else that is not a class."""
    from bus.schema import MessageSchema, support_of  # few programs have messages without a class

    if isinstance(message_type, MessageSchema):
        return support_of(message_type, raw=raw)
    return type_support(message_type)


def link_of(node: Node) -> Link | None:
    """The link of an open node, for other modules of this library."""
    return node._link


def report_error(node: Node, error: BaseException) -> None:
    """Report `error` as an exception of a callback of `node`, for other modules of this library."""
    node._fail(error)


def reminder_of(node: Node) -> CloseReminder:
    """The object that acts if the program drops `node` without closing it."""
    return node._reminder

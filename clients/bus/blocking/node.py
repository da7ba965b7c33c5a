"""Nodes for scripts: every call waits until it is done, and the program needs no event loop.

    with bus.connect("talker") as node:
        node.publish("topic", String(data="hi"))

A node of the library (`bus.Node`) on a loop that runs only while one of these calls waits. Between the calls
nothing runs.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar, overload

import msgspec

from bus.blocking.endpoint import (
    BlockingPublisher,
    BlockingSubscription,
    make_publisher,
    warn_if_unreceived,
)
from bus.endpoint.endpoint import core_of
from bus.errors import ConnectionClosed
from bus.graph import Graph
from bus.link.link import Link
from bus.logger import Logger
from bus.node import Node
from bus.node.node import link_of, reminder_of
from bus.process.foreground import Foreground, Signal, deadline_after
from bus.process.termination import say_nothing_of_signals
from bus.qos import QoS
from bus.schema import MessageSchema
from bus.subscription import Subscription

if TYPE_CHECKING:
    from bus.service.client import ServiceClient

M = TypeVar("M", bound=msgspec.Struct)


class BlockingNode:
    """A node with blocking calls; made by `bus.connect`, ended by `with` or `close`.

    `publish`, `listen`, `wait_for_message` and `call` create their endpoint at the first use for a topic or
    service, and keep it. So a second call of `listen` gets the messages since the first, within the depth.

        with bus.connect("script") as node:
            node.publish("chatter", String(data="hi"))
    """

    def __init__(self, node: Node, foreground: Foreground) -> None:
        self.name: str = node.name
        """Its own name, without the namespace, after remapping."""
        self.namespace: str = node.namespace
        """Starts with a slash; `/` for none."""
        self.full_name: str = node.full_name
        """Namespace and name, as the graph shows them."""
        self._node = node
        self._reminder = reminder_of(node)
        self._reminder.how_to_close = "use with bus.connect(...), or its close()"
        self._reminder.when_dropped = foreground.dropped
        self._foreground = foreground
        self._is_closed = False
        self._publishers: dict[tuple[str, QoS], BlockingPublisher[Any]] = {}
        self._subscriptions: dict[tuple[type, str, QoS], BlockingSubscription[Any]] = {}
        self._clients: dict[tuple[type, str], ServiceClient] = {}
        self._made: list[BlockingPublisher[Any]] = []

    def __repr__(self) -> str:
        return f"<Blocking{repr(self._node)[1:]}"

    def __del__(self, _link_of: Callable[[Node], Link | None] = link_of) -> None:
        """Warn, because no code can close the node any more.

        Its endpoints keep it open while they are in use.
        """
        if self.__dict__.get("_is_closed", True) or self._foreground.failure is not None:
            return
        self._reminder.must_be_closed = False
        try:
            self._reminder.warn(self._node)
        finally:
            link = _link_of(self._node)  # a default, because a module's names may be gone at the end
            if link is not None and not sys.is_finalizing() and self._foreground.may_attend():
                with self._foreground.loop.guard:
                    link.report_now()  # else due reports keep the node alive

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def publish(self, topic: str, message: Any, qos: QoS = 10, timeout: float | None = None) -> None:
        """Publish `message` on `topic`; see `BlockingPublisher.publish`.

        Every existing subscription gets it, even if the script ends right away. A subscription that starts
        later does not: `create_publisher(...).wait_for_subscriptions()` waits for one.
        """
        publisher = self._publishers.get((topic, qos))
        if publisher is None:
            publisher = self._publishers[topic, qos] = self.create_publisher(type(message), topic, qos)
        publisher.publish(message, timeout)

    def listen(
        self, message_type: type[M], topic: str, qos: QoS = 10, timeout: float | None = None
    ) -> Iterator[M]:
        """Yield messages on `topic`: `for message in node.listen(String, "topic", timeout=1)`.

        Receives messages from this call on. Ends when none has arrived for `timeout` seconds.
        """
        return self._subscription(message_type, topic, qos).listen(timeout)

    def wait_for_message(
        self, message_type: type[M], topic: str, qos: QoS = 10, timeout: float | None = None
    ) -> M:
        """The next message on `topic`. Raises TimeoutError if none arrives within `timeout` seconds."""
        return self._subscription(message_type, topic, qos).receive(timeout)[0]

    def call(self, service_type: type[Any], name: str, request: Any, timeout: float | None = None) -> Any:
        """Call the service `name` and wait for its answer.

        Raises TimeoutError if none arrives within `timeout` seconds, and the errors of
        `bus.ServiceClient.call`: ServiceUnavailable if no server exists (see `wait_for_service`),
        ServiceError if the service's callback raised an exception.
        """
        client = self._client(service_type, name)
        return self._opened().run_or_tell(
            lambda: client.call(request), timeout, lambda: f"no answer of service '{client.service_name}'"
        )

    def wait_for_service(self, service_type: type[Any], name: str, timeout: float | None = None) -> None:
        """Wait until a server of `name` exists. Raises TimeoutError after `timeout` seconds."""
        client = self._client(service_type, name)
        self._opened().run_or_tell(
            client.wait_for_service, timeout, lambda: f"no server for '{client.service_name}'"
        )

    @overload
    def create_publisher(self, message_type: type[M], topic: str, qos: QoS = 10) -> BlockingPublisher[M]: ...

    @overload
    def create_publisher(
        self, message_type: MessageSchema, topic: str, qos: QoS = 10
    ) -> BlockingPublisher[Any]: ...

    def create_publisher(
        self, message_type: type[M] | MessageSchema, topic: str, qos: QoS = 10
    ) -> BlockingPublisher[Any]:
        """Create a publisher of `message_type` on `topic`; on return every existing subscription knows it.

        With a `MessageSchema` instead of a class, messages are published as encoded bytes. Raises the errors
        of `bus.Node.create_publisher`.
        """
        foreground, node = self._opened(), self._node
        publisher: BlockingPublisher[Any] = foreground.run(
            lambda: make_publisher(foreground, node, message_type, topic, qos)
        )
        self._made = [one for one in self._made if core_of(one).refusal is None]
        self._made.append(publisher)
        return publisher

    @overload
    def create_subscription(
        self,
        message_type: type[M],
        topic: str,
        qos: QoS = 10,
        *,
        raw: Literal[False] = False,
        views: bool = False,
    ) -> BlockingSubscription[M]: ...

    @overload
    def create_subscription(
        self,
        message_type: type[Any] | MessageSchema | str | None,
        topic: str,
        qos: QoS = 10,
        *,
        raw: bool = False,
        views: bool = False,
    ) -> BlockingSubscription[Any]: ...

    def create_subscription(
        self,
        message_type: type[M] | MessageSchema | str | None,
        topic: str,
        qos: QoS = 10,
        *,
        raw: bool = False,
        views: bool = False,
    ) -> BlockingSubscription[Any]:
        """Create a separate subscription to `topic`.

        It gets every message whose publishing begins after the return, within its depth. Takes the parameters
        of `bus.Node.create_subscription`, and raises its errors.
        """
        node = self._node
        foreground = self._opened()
        native: Subscription[Any] = foreground.run(
            lambda: node.create_subscription(message_type, topic, qos, raw=raw, views=views)
        )
        return BlockingSubscription(foreground, native)

    def sleep(self, seconds: float) -> None:
        """Sleep; meanwhile the node keeps sending to busd what is due.

        `time.sleep` is enough if no QoS of this node has liveliness with a lease.
        """
        deadline_ns = deadline_after(seconds)
        foreground = self._opened()
        foreground.check()
        with foreground.loop:
            foreground.wait(Signal(), deadline_ns)

    def get_logger(self) -> Logger:
        """The logger of this node; it writes ROS 2's log lines to stderr, and to the topic /rosout."""
        return self._node.get_logger()

    def resolve_topic_name(self, topic: str) -> str:
        """The full name of `topic` in this node, after expansion and remapping."""
        return self._node.resolve_topic_name(topic)

    def graph(self, *, statistics: bool = False) -> Graph:
        """All nodes, endpoints and matches now; with the endpoints' live counters if asked."""
        return self._opened().run(lambda: self._node.graph(statistics=statistics))

    def wait_for_graph(self, condition: Callable[[Graph], bool], timeout: float | None = None) -> Graph:
        """Wait until `condition(graph)` is true; returns that graph. Raises TimeoutError after `timeout`
        seconds."""
        return self._opened().run_or_tell(
            lambda: self._node.wait_for_graph(condition), timeout, lambda: "the graph is not as it should be"
        )

    def close(self) -> None:
        """Hand over published messages, leave the graph. Closing twice is allowed."""
        if self._is_closed:
            return
        if self._foreground.failure is None:
            self._foreground.check()
        self._is_closed = True
        try:
            if self._foreground.failure is None:  # else this is a fork, and only the parent leaves
                for publisher in self._made:
                    warn_if_unreceived(publisher)
                self._foreground.run(self._node.close)
        finally:
            self._foreground.release()

    # --- inside

    def _opened(self) -> Foreground:
        if self._is_closed:
            raise ConnectionClosed(f"node {self.full_name} is closed")
        return self._foreground

    def _subscription(self, message_type: type[M], topic: str, qos: QoS) -> BlockingSubscription[M]:
        kept = self._subscriptions.get((message_type, topic, qos))
        if kept is None:
            kept = self.create_subscription(message_type, topic, qos)
            self._subscriptions[message_type, topic, qos] = kept
        return kept

    def _client(self, service_type: type[Any], name: str) -> "ServiceClient":
        kept = self._clients.get((service_type, name))
        if kept is None:
            kept = self._opened().run(lambda: self._node.create_client(service_type, name))
            self._clients[service_type, name] = kept
        return kept


def connect(
    name: str,
    *,
    namespace: str = "",
    arguments: Sequence[str] | None = None,
    socket: str | PathLike[str] | None = None,
    domain: int | None = None,
    rosout: bool = True,
) -> BlockingNode:
    """A node for a script, connected; use it as `with bus.connect("talker") as node:`.

    Takes the parameters of `bus.Node`. The node belongs to the thread that connected; only `publish` may be
    called from any thread.

    Raises:

    - ConfigurationError: the name breaks the rules
    - BrokerUnavailable: no busd answers and none could be started
    - LocalProtocolError: an event loop runs in this thread; use `bus.Node` there
    """
    try:
        node = Node(
            name, namespace=namespace, arguments=arguments, socket=socket, domain=domain, rosout=rosout
        )
        foreground = Foreground.acquire(f"async with bus.Node({name!r}) as node")
    except KeyboardInterrupt:  # raised before Foreground's handler, which prints nothing
        if not hasattr(sys, "ps1"):
            say_nothing_of_signals()
        raise
    try:
        foreground.run(node.open)
    except BaseException:
        foreground.release()
        raise
    return BlockingNode(node, foreground)

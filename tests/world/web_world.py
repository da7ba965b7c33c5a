"""A bus of a few lists for the parts of `bus_web` above a node: no busd, no socket, no WebSocket.

    world = WebWorld()
    world.add("publisher", "/talker", "/chatter", String)
    world.look()
    ... world.hub, world.client ...
    assert await world.told() == [{"op": "..."}]

The hub, its model, its shared subscriptions and the sender of frames are the real ones. The node only lists
its endpoints, and answers as the test sets it.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import msgspec

from bus.errors import ConfigurationError, ConnectionClosed
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.names import reply_topic, request_topic
from bus.qos import QoSProfile
from bus.schema import MessageSchema, schema_of, support_of
from bus.subscription import MessageInfo
from bus.types.schema import build
from bus.types.service import service_support
from bus.types.support import type_support
from bus_web.foxglove.client import Client
from bus_web.foxglove.formats import Formats
from bus_web.hub import Hub
from bus_web.outbox import Outbox
from bus_web.playback import Playback, Recording, Request, State, Status

__all__ = ["PID", "ListPlayback", "ListSocket", "WebWorld", "turns"]

PID = 77
_S = 1_000_000_000


class ListSocket:
    """`sent` has the frames to the client, `said` the frames from it. While it `is_stuck`, it sends none."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.said: asyncio.Queue[str | bytes] = asyncio.Queue()
        self.may_send = asyncio.Event()
        self.may_send.set()

    async def send(self, message: bytes, *, text: bool) -> None:
        await self.may_send.wait()
        assert text == message.startswith(b"{")
        self.sent.append(message)

    async def recv(self) -> str | bytes:
        return await self.said.get()

    def texts(self) -> list[dict[str, Any]]:
        """The sent texts, decoded."""
        return [msgspec.json.decode(one) for one in self.sent if one.startswith(b"{")]


class ListSubscription:
    def __init__(self, profile: QoSProfile, hear: Callable[[bytes, MessageInfo], None]) -> None:
        self.profile = profile
        self.hear = hear
        self.is_closed = False

    async def close(self) -> None:
        self.is_closed = True


class ListPublisher:
    def __init__(self, schema: MessageSchema, topic_name: str) -> None:
        self.topic_name = topic_name
        self._decode = support_of(schema, raw=False).decode
        self.published: list[Any] = []
        self.is_closed = False

    def publish_encoded(self, payload: Any) -> None:
        self.published.append(self._decode(payload))

    async def close(self) -> None:
        self.is_closed = True


class ListServiceClient:
    def __init__(self, serve: Callable[[Any], Any] | None) -> None:
        self._serve = serve
        self.is_closed = False

    async def wait_for_service(self) -> None:
        if self._serve is None:
            raise TimeoutError

    async def call(self, request: Any) -> Any:
        assert self._serve is not None
        return self._serve(request)

    async def close(self) -> None:
        self.is_closed = True


class ListNode:
    """Makes endpoints and keeps them in lists, by topic or service."""

    name = f"_bus_web_{PID}"
    is_connected = True

    def __init__(self) -> None:
        self.now: Graph | None = None
        self.schemas: dict[tuple[str, str], MessageSchema] = {}
        self.serving: dict[str, Callable[[Any], Any]] = {}
        self.subscriptions: dict[str, list[ListSubscription]] = {}
        self.publishers: dict[str, list[ListPublisher]] = {}
        self.clients: dict[str, list[ListServiceClient]] = {}

    async def graph(self, *, statistics: bool) -> Graph:
        if not self.is_connected:
            raise ConnectionClosed("busd is away")
        assert self.now is not None
        return self.now

    async def watch_graph(self) -> AsyncIterator[Graph]:
        await asyncio.Event().wait()
        yield await self.graph(statistics=False)

    async def get_schema(self, type_name: str, type_hash: str) -> MessageSchema:
        try:
            return self.schemas[type_name, type_hash]
        except KeyError:
            raise ConfigurationError(f"no endpoint has {type_name} any more") from None

    async def get_type(self, type_name: str, type_hash: str) -> Any:
        return build((await self.get_schema(type_name, type_hash)).description)

    async def create_subscription(
        self, schema: MessageSchema, topic: str, profile: QoSProfile, hear: Any, *, raw: bool
    ) -> ListSubscription:
        assert raw
        made = ListSubscription(profile, hear)
        self.subscriptions.setdefault(topic, []).append(made)
        return made

    async def create_publisher(self, schema: MessageSchema, topic: str, depth: int) -> ListPublisher:
        made = ListPublisher(schema, topic)
        self.publishers.setdefault(topic, []).append(made)
        return made

    async def create_client(self, definition: Any, name: str) -> ListServiceClient:
        made = ListServiceClient(self.serving.get(name))
        self.clients.setdefault(name, []).append(made)
        return made


class ListPlayback(Playback):
    """A player of a recording of ten seconds from second 100 on. It only lists the requests.

    `change` sets the state. Requests wait for `may_answer`, and are refused with `refusal`.
    """

    def __init__(self) -> None:
        self.now = State(Status.PAUSED, True, 100 * _S, 1.0, 0, 0)
        self.about = Recording("walk", 100 * _S, 110 * _S, {})
        self.asked: list[Request] = []
        self.refusal = ""
        self.may_answer = asyncio.Event()
        self.may_answer.set()
        self.watchers: list[Callable[[], None]] = []

    @property
    def recording(self) -> Recording:
        return self.about

    @property
    def state(self) -> State:
        return self.now

    async def ask(self, request: Request, jumped: Callable[[], None] | None = None) -> str:
        await self.may_answer.wait()
        self.asked.append(request)
        if request.seek_ns is not None and not self.refusal:
            self.now = self.now._replace(seeks=self.now.seeks + 1, at_ns=request.seek_ns)
            if jumped is not None:
                jumped()
            self.change()
        return self.refusal

    def change(self, **fields: Any) -> None:
        self.now = self.now._replace(**fields)
        for changed in [*self.watchers]:
            changed()

    @contextmanager
    def watching(self, changed: Callable[[], None]) -> Iterator[None]:
        self.watchers.append(changed)
        try:
            yield
        finally:
            self.watchers.remove(changed)


class WebWorld:
    """Endpoints that come and go, a hub that looks at them, and one client that gets the news."""

    def __init__(self) -> None:
        self.node = ListNode()
        self.hub = Hub(cast(Any, self.node), PID)
        self.formats = Formats(cast(Any, self.node))
        self.socket = ListSocket()
        self.client = Client(self.socket, Outbox())
        self._sending: asyncio.Task[None] | None = None
        self._nodes: dict[str, GraphNode] = {}
        self._ends: list[GraphEndpoint] = []
        self._revision = 0
        self._numbers = 0
        self._seen = 0

    def add(
        self, kind: str, node: str, topic: str, cls: Any = None, qos: QoSProfile | None = None, **others: Any
    ) -> GraphEndpoint:
        """Add an endpoint of a message class, or with the attributes in `others`."""
        if cls is not None:
            schema = schema_of(type_support(cls))
            self.node.schemas[schema.type_name, schema.type_hash] = schema
            others = {"type_name": schema.type_name, "type_hash": schema.type_hash, **others}
        namespace, _, name = node.rpartition("/")
        about = self._nodes.setdefault(node, GraphNode(len(self._nodes) + 1, name, namespace or "/", 10))
        self._numbers += 1
        gid = self._numbers.to_bytes(16, "big")
        made = GraphEndpoint(self._numbers, kind, about, topic, gid=gid, qos=qos or QoSProfile(5), **others)
        self._ends.append(made)
        return made

    def serve(self, node: str, service: str, definition: Any, callback: Callable[[Any], Any]) -> None:
        """Add a server to the graph, with a function for its answers."""
        support = service_support(definition)
        for kind, topic, part in (
            ("subscription", request_topic(service), support.requests),
            ("publisher", reply_topic(service), support._answers),
        ):
            self.node.schemas[part.name, part.hash] = MessageSchema(part.name, part.hash, part.description)
            self.add(kind, node, topic, type_name=part.name, type_hash=part.hash)
        self.node.serving[service] = callback

    def remove(self, topic: str) -> None:
        """Remove all endpoints of a topic."""
        self._ends = [one for one in self._ends if one.topic != topic]

    def look(self) -> Graph:
        """Let the hub look at the graph."""
        self._revision += 1
        publishers = tuple(one for one in self._ends if one.kind == "publisher")
        subscriptions = tuple(one for one in self._ends if one.kind == "subscription")
        nodes = tuple(self._nodes.values())
        graph = self.node.now = Graph(self._revision, 1, nodes, publishers, subscriptions, ())
        self.hub.model.take(graph, self._revision * _S)
        self.hub.subscriptions.follow(graph)
        self.hub._show(is_new=True)
        return graph

    def publish(self, one: GraphEndpoint, message: Any, *, sent_ns: int = _S, came_ns: int = 2 * _S) -> None:
        """Publish to all subscriptions of the node."""
        payload = type_support(type(message)).encode(message)
        for subscription in self.node.subscriptions.get(one.topic, ()):
            if not subscription.is_closed:
                subscription.hear(payload, MessageInfo(sent_ns, came_ns, 1, 1, one.gid))

    async def told(self) -> list[dict[str, Any]]:
        """The texts sent to the client since the last call."""
        if self._sending is None:
            self._sending = asyncio.get_running_loop().create_task(self.client.run())
        await self.client.drain()
        before, self._seen = self._seen, len(self.socket.texts())
        return self.socket.texts()[before:]

    async def close(self) -> None:
        """End running tasks."""
        if self._sending is not None:
            self._sending.cancel()
            await asyncio.gather(self._sending, return_exceptions=True)
        await self.hub.aclose()


async def turns(number: int = 10) -> None:
    """Let ready tasks have their turns on the event loop, and tasks that these make ready."""
    for _ in range(number):
        await asyncio.sleep(0)

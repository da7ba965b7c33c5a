"""Action servers and clients on a bus of a few lists: no busd, no socket, no process.

    world = ActionWorld()
    async with world.server(Count, count) as server, world.client(Count) as client:
        goal = await client.send_goal(Count.Goal(target=3))
        assert (await goal.result()).reached == 3

`bus_actions` is the real package; its nodes only list the endpoints that it makes. A message arrives in a
later turn of the event loop; messages arrive in the order of sending. A publisher sends at the end of a
turn, as by socket, or if it must hand over its messages. While `world.is_held`, nothing arrives. While
`world.is_unread`, messages of topics wait in their subscriptions.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import msgspec

from bus.endpoint.core import NodeContext
from bus.errors import BusError, ConnectionClosed, ServiceError, ServiceUnavailable
from bus.msg.builtin_interfaces import Time
from bus.qos import QoSProfile
from bus.service.client_core import CallLost
from bus.service.server_core import RequestId, ServerCore
from bus.types.support import type_support
from bus_actions import ActionClient, ActionServer

__all__ = ["NAME", "ActionWorld"]

NAME = "/act"


class _Logger:
    name = "acting"

    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


class ListService(ServerCore):
    """A server of a service. `answers` has the request ids and responses of all its answers."""

    def __init__(
        self, world: "ActionWorld", definition: Any, name: str, on_request: Callable[[Any, RequestId], Any]
    ) -> None:
        self.on_request = on_request
        self.answers: list[tuple[RequestId, Any]] = []
        self.has_room = asyncio.Event()
        self.has_room.set()
        self._core = self
        self._is_closed = False
        self._world = world
        link: Any = SimpleNamespace(loop=asyncio.get_running_loop())
        self._endpoint: Any = SimpleNamespace(
            on_end=None, on_lost=None, refused=0, max_bytes=2**26, link=link
        )
        node = NodeContext(
            link, NAME, cast(Any, world.server_node.logger), cast(Any, world.server_node)._fail
        )
        super().__init__(node, name, definition, QoSProfile(), on_request=on_request)

    def make_publisher(self, *_: object) -> Any:
        return SimpleNamespace(
            publish_encoded=self._publish_encoded, wait_for_room=self._wait, _core=self._endpoint
        )

    def make_subscription(self, *_: object) -> Any:
        return SimpleNamespace(_core=self._endpoint)

    def _publish_encoded(self, payload: bytes) -> bool:
        if not self.has_room.is_set():
            return False
        client, number, *_ = msgspec.msgpack.decode(payload)
        reply = self.support.replies(client).decode(payload)
        outcome = ServiceError(self.service_name, reply.error) if reply.error else reply.body
        request_id = RequestId(client, number)
        self.answers.append((request_id, outcome))
        self._world.send(self._world.answer, request_id, self.service_name, outcome)
        return True

    async def _wait(self) -> None:
        await self.has_room.wait()
        if self._is_closed:
            raise ConnectionClosed("the service is closed")

    async def close(self) -> None:
        self._is_closed = True
        self.has_room.set()
        self._world.services.pop(self.service_name, None)


class ListServiceClient:
    def __init__(
        self, world: "ActionWorld", name: str, gid: bytes, on_response: Callable[[int, Any], object]
    ) -> None:
        self.service_name = name
        self.gid = gid
        self.on_response = on_response
        self.calls: set[int] = set()
        self.requests = self
        self._core = self
        self._world = world
        self._number = 0

    def service_is_ready(self) -> bool:
        return self.service_name in self._world.services

    def check_served(self) -> None:
        if not self.service_is_ready():
            raise ServiceUnavailable(self.service_name, "no server exists")

    def send_request(self, request: Any) -> int:
        self._number += 1
        self.calls.add(self._number)
        self._world.send(self._world.ask, self.service_name, request, RequestId(self.gid, self._number))
        return self._number

    def forget(self, number: int) -> bool:
        is_known = number in self.calls
        self.calls.discard(number)
        return is_known

    def settle(self, number: int, outcome: Any) -> None:
        if self.forget(number):
            self.on_response(number, outcome)

    async def close(self) -> None:
        for number in sorted(self.calls):
            self.settle(number, ConnectionClosed("the client was closed"))


class ListPublisher:
    def __init__(self, world: "ActionWorld", message_type: Any, topic: str) -> None:
        self.topic = topic
        self._core = self
        self.published: list[Any] = []
        self._world = world
        self._support = type_support(message_type)
        self._run: list[Any] = []

    def publish(self, message: Any) -> None:
        self.publish_encoded(self._support.encode(message))

    def publish_encoded(self, payload: Any) -> None:
        message = self._support.decode(payload)
        self.published.append(message)
        self._run.append(message)
        asyncio.get_running_loop().call_soon(self.hand_over)

    def hand_over(self) -> None:
        run, self._run = self._run, []
        for message in run:
            self._world.send(self._world.deliver, self.topic, message)

    async def close(self) -> None:
        self.hand_over()
        self._world.publishers.pop(self.topic, None)


class ListSubscription:
    """A subscription. A message goes to the callback when it arrives, unless the world `is_unread`."""

    def __init__(self, world: "ActionWorld", topic: str, callback: Callable[[Any], object]) -> None:
        self.callback = callback
        self.waiting: deque[Any] = deque()
        self._core = self
        self.receiver = self
        self._world = world
        self._topic = topic

    def get_publisher_count(self) -> int:
        return int(self._topic in self._world.publishers)

    def take(self) -> tuple[Any, None] | None:
        return (self.waiting.popleft(), None) if self.waiting else None

    async def close(self) -> None:
        for ends in self._world.subscriptions.values():
            if self in ends:
                ends.remove(self)


class ListNode:
    """A node; `errors` are the exceptions that callbacks raised."""

    def __init__(self, world: "ActionWorld") -> None:
        self.errors: list[Exception] = []
        self.logger = _Logger()
        self._world = world

    def get_logger(self) -> _Logger:
        return self.logger

    def now(self) -> Time:
        sec, nanosec = divmod(self._world.now_ns, 1_000_000_000)
        return Time(sec=sec, nanosec=nanosec)

    def _fail(self, error: Exception) -> None:
        self.errors.append(error)

    async def create_publisher(self, message_type: Any, topic: str, qos: object) -> ListPublisher:
        made = self._world.publishers[topic] = ListPublisher(self._world, message_type, topic)
        return made

    async def create_subscription(
        self, message_type: Any, topic: str, qos: object, callback: Callable[[Any], object]
    ) -> ListSubscription:
        made = ListSubscription(self._world, topic, callback)
        self._world.subscriptions.setdefault(topic, []).append(made)
        return made

    async def create_service(
        self, definition: Any, name: str, *, qos: object, on_request: Callable[[Any, RequestId], Any]
    ) -> ListService:
        made = self._world.services[name] = ListService(self._world, definition, name, on_request)
        if self._world.in_opening is not None:
            await self._world.in_opening(made)
        return made

    async def create_client(
        self, definition: Any, name: str, qos: object, *, on_response: Callable[[int, Any], object]
    ) -> ListServiceClient:
        gid = len(self._world.clients).to_bytes(16, "big")
        made = self._world.clients[gid] = ListServiceClient(self._world, name, gid, on_response)
        return made


_servers: list[ActionServer] = []
"""Kept for good: else the collector may find the tasks of a lost server before the loop cancels them."""


class ActionWorld:
    """Nodes with endpoints that find each other by name; `now_ns` is their clock."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000
        self.is_held = False
        self.is_unread = False
        self.in_opening: Callable[[ListService], Any] | None = None
        """Awaited after each new service."""
        self.services: dict[str, ListService] = {}
        self.clients: dict[bytes, ListServiceClient] = {}
        self.publishers: dict[str, ListPublisher] = {}
        self.subscriptions: dict[str, list[ListSubscription]] = {}
        self.server_node = ListNode(self)
        self.client_node = ListNode(self)
        self._waiting: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()
        self._tasks: set[asyncio.Task[None]] = set()

    def server(self, action: Any, execute: Callable[..., Any], **options: Any) -> ActionServer:
        server = ActionServer(cast(Any, self.server_node), action, NAME, execute, **options)
        _servers.append(server)
        return server

    def client(self, action: Any) -> ActionClient:
        return ActionClient(cast(Any, self.client_node), action, NAME)

    def service(self, kind: str) -> ListService:
        """The service `send_goal`, `cancel_goal` or `get_result`."""
        return self.services[f"{NAME}/_action/{kind}"]

    def statuses(self) -> list[list[int]]:
        """The published status messages: the states of all goals in each."""
        published = self.publishers[f"{NAME}/_action/status"].published
        return [[one.status for one in message.status_list] for message in published]

    def release(self) -> None:
        """Deliver everything that was held."""
        self.is_held = False
        self._arrive()

    def lose_server(self) -> None:
        """The server's process dies: pending calls get an error."""
        self._waiting.clear()
        self.services.clear()
        self.publishers.clear()
        self._fail_calls(ServiceUnavailable(NAME, "it left"))

    def lose_busd(self) -> None:
        """busd dies with all messages in transit, and is back at once."""
        self._waiting.clear()
        self._fail_calls(CallLost(NAME))

    def _fail_calls(self, outcome: BusError) -> None:
        for client in tuple(self.clients.values()):
            for number in sorted(client.calls):
                client.settle(number, outcome)

    # --- for the endpoints

    def send(self, arrive: Callable[..., None], *arguments: Any) -> None:
        self._waiting.append((arrive, arguments))
        asyncio.get_running_loop().call_soon(self._arrive)

    def _arrive(self) -> None:
        while self._waiting and not self.is_held:
            arrive, arguments = self._waiting.popleft()
            arrive(*arguments)

    def ask(self, name: str, request: Any, request_id: RequestId) -> None:
        service = self.services.get(name)
        if service is None:
            return
        work = service.on_request(request, request_id)
        if work is not None:
            task = asyncio.get_running_loop().create_task(self._call(work))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _call(self, work: Any) -> None:
        try:
            await work
        except Exception as error:
            self.server_node._fail(error)

    def answer(self, request_id: RequestId, name: str, outcome: Any) -> None:
        if request_id.client in self.clients:
            self.clients[request_id.client].settle(request_id.number, outcome)

    def deliver(self, topic: str, message: Any) -> None:
        for subscription in tuple(self.subscriptions.get(topic, ())):
            if self.is_unread:
                subscription.waiting.append(message)
            else:
                subscription.callback(message)

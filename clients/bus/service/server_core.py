"""The internal part of a server: requests arrive on a hidden topic, answers leave on another.

Owns: the server's two endpoints, the calls of its callback, and the answers that wait for room. Must not
know: the user's object, clients, nodes, graphs.

The publisher of replies is declared before the subscription to requests; a client does it the other way
round. So when a request arrives here, its client can already receive the answer.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, NamedTuple

import msgspec

from bus.base.callbacks import call_async, is_async, takes_info
from bus.diagnostics.provoked import warn
from bus.endpoint.core import EndpointCore, NodeContext
from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ConnectionClosed, PayloadTooLarge
from bus.names import reply_topic, request_topic
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.service.base import ServiceCore
from bus.subscription import Subscription
from bus.types.service import Request

__all__ = ["RequestId", "ServerCore", "ServiceServerStatistics"]

_MOST_AT_ONCE: Final = 100
_MOST_AT_WORK: Final = 10_000
"""Most unanswered requests that the server keeps, and most answers that wait for room. Older ones are
lost."""
_LATE_BYTES: Final = 64 << 20
"""Most bytes of answers that wait for room."""
_MOST_LOST: Final = 1000
"""Most dead clients that the server keeps; it carries out requests of earlier ones."""


class RequestId(NamedTuple):
    """Identifies a call by its client and number; passed to `on_request` of a `ServiceServer`.

    For example:

        server.respond(request_id, AddTwoInts.Response(sum=3))
    """

    client: bytes
    """The client's gid."""
    number: int
    """From 1, one more with each of its requests."""


class _Answer(NamedTuple):
    """An encoded answer."""

    request_id: RequestId
    payload: bytes
    is_error: bool


class _LateAnswers:
    """Answers that wait for room, in their order. Above the bounds, the oldest ones are lost."""

    def __init__(self) -> None:
        self._answers: deque[_Answer] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._answers)

    @property
    def oldest(self) -> _Answer:
        return self._answers[0]

    def put(self, answer: _Answer) -> list[_Answer]:
        """Add an answer; returns the lost ones."""
        self._answers.append(answer)
        self._bytes += len(answer.payload)
        lost = []
        while len(self._answers) > _MOST_AT_WORK or (self._bytes > _LATE_BYTES and len(self._answers) > 1):
            lost.append(self.pop())
        return lost

    def pop(self) -> _Answer:
        """Remove the oldest answer."""
        answer = self._answers.popleft()
        self._bytes -= len(answer.payload)
        return answer


class ServiceServerStatistics(msgspec.Struct, frozen=True):
    """Totals of one server.

    For example:

        print(server.statistics().requests)
    """

    requests: int
    """Requests taken."""
    responses: int
    """Answers sent, including error answers."""
    errors: int
    """Error answers among `responses`."""
    refused: int
    """Answers lost because there was no room (QoS keep all). Answers of a callback wait for room first."""
    dropped: dict[str, int]
    """Requests lost on the way, by reason, as of a subscription."""
    clients: int
    """Clients matched now."""
    skipped: int
    """Requests not carried out because their client had died before their turn."""


class ServerCore(ServiceCore):
    """The part of a ServiceServer that users do not see. Its options are those of `Node.create_service`."""

    other = "client"
    type_consequence = "no requests will be taken from its client"

    requests: Subscription[Any]
    replies: Publisher[Any]

    def __init__(
        self,
        node: NodeContext,
        service: str,
        service_type: Any,
        qos: QoSProfile,
        *,
        callback: Callable[..., Any] | None = None,
        on_request: Callable[[Any, RequestId], Any] | None = None,
    ) -> None:
        super().__init__(node, service, service_type, qos)
        self._taken = self._answered = self._errors = self._skipped = 0
        self._lost: dict[bytes, None] = {}
        """Gids of clients that have died, the latest last."""
        self.at_work: dict[RequestId, None] = {}
        """Requests that were taken and not answered."""
        self._late = _LateAnswers()
        """Answers that wait for room; `sending` publishes them."""
        self.sending: asyncio.Task[None] | None = None
        if (callback is None) is (on_request is None):
            raise TypeError("a service needs either a callback or on_request")
        self._work = None if callback is None else _Work(self, callback, node.on_error)
        if self._work is not None:
            on_request = self._work.on_request
        assert on_request is not None
        self._on_request = on_request
        self.replies = self.make_publisher(reply_topic(service), self.support.replies(b""))
        self.requests = self.make_subscription(
            request_topic(service),
            self.support.requests,
            self._take_async if is_async(on_request) else self._take,
        )
        core_of(self.requests).on_lost = self._lose

    # --- for the user's object

    @property
    def endpoints(self) -> tuple[EndpointCore[Any], EndpointCore[Any]]:
        return core_of(self.replies), core_of(self.requests)

    def counts(self) -> str:
        return f"clients={len(self.requests.matches)} requests={self._taken} responses={self._answered}"

    def respond(self, request_id: RequestId, response: Any, error: str = "") -> bool:
        """As `ServiceServer.respond`."""
        return self._publish(self._encode(request_id, response, error))

    def statistics(self) -> ServiceServerStatistics:
        """As `ServiceServer.statistics`."""
        requests = self.requests.statistics()
        return ServiceServerStatistics(
            requests=self._taken,
            responses=self._answered,
            errors=self._errors,
            refused=self.replies.statistics().refused,
            dropped=requests.dropped,
            clients=requests.publishers,
            skipped=self._skipped,
        )

    # --- for callbacks, actions and the facade

    def skip(self, request_id: RequestId) -> bool:
        """Whether to skip a request because its client has died; then count it."""
        client = request_id.client
        if client not in self._lost:
            return False
        if any(match.gid == client for match in self.requests.matches):  # it had only lost its connection
            del self._lost[client]
            return False
        self._skipped += 1
        self.at_work.pop(request_id, None)
        return True

    def answer(self, request_id: RequestId, response: Any, error: str = "") -> bool:
        """As `respond`, for a caller that does not wait for room; without effect after `close`.

        Without room, the answer follows later. Above the limit, its client gets the error instead; then it
        returns False.
        """
        core = core_of(self.replies)
        answer = self._encode(request_id, response, error)
        size = len(answer.payload)
        is_too_large = size > core.max_bytes
        if is_too_large:
            # Perhaps the client requested that much: it gets the error, and the server continues for the
            # others.
            too_large = PayloadTooLarge(self.replies.topic_name, size_bytes=size, limit_bytes=core.max_bytes)
            core.link.loop.call_soon(self._warn_of_size, too_large)
            answer = self._encode(request_id, None, _text_of(too_large))
        try:
            if not self._late:
                if self._publish(answer):
                    return not is_too_large
                core.refused -= 1  # it is not lost
            self._keep(answer)
        except (ConnectionClosed, PayloadTooLarge):
            pass  # PayloadTooLarge: not even the error is below the limit
        return not is_too_large

    def refuse(self, request_id: RequestId, error: Exception) -> None:
        """Answer the client with the error of a callback."""
        with suppress(BusError):  # the caller raises the cause
            self.answer(request_id, None, _text_of(error))

    # --- inside

    def _lose(self, client: bytes) -> None:
        """Note a client that has died."""
        self._lost.pop(client, None)
        self._lost[client] = None
        if len(self._lost) > _MOST_LOST:
            del self._lost[next(iter(self._lost))]

    def _encode(self, request_id: RequestId, response: Any, error: str) -> _Answer:
        if error:
            return _Answer(request_id, self.support.encode_error(*request_id, error), True)
        return _Answer(request_id, self.support.encode_response(*request_id, response), False)

    def _publish(self, answer: _Answer) -> bool:
        """Returns whether there was room."""
        if not self.replies.publish_encoded(answer.payload):
            return False
        self.at_work.pop(answer.request_id, None)
        self._answered += 1
        self._errors += answer.is_error
        return True

    def _keep(self, answer: _Answer) -> None:
        """Publish an answer as soon as there is room, after the earlier ones."""
        for lost in self._late.put(answer):
            self._count_lost(lost)
        if self.sending is None:
            # Not always the running loop: see bus_ros.engine.
            self.sending = core_of(self.replies).link.loop.create_task(
                self._publish_late(), name=f"answers of {self.service_name}"
            )

    async def _publish_late(self) -> None:
        try:
            while self._late:
                await self.replies.wait_for_room()
                while self._late and self._publish_oldest():
                    self._late.pop()
        except ConnectionClosed:
            while self._late:
                self._count_lost(self._late.pop())
        finally:
            self.sending = None

    def _publish_oldest(self) -> bool:
        """Publish the oldest waiting answer; returns False if it has to wait longer."""
        answer = self._late.oldest
        try:
            if self._publish(answer):
                return True
        except ConnectionClosed:
            raise
        except BusError as error:  # for example, memory is short; the answers behind it follow
            self._count_lost(answer)
            warn(self.logger, f"an answer of service '{self.service_name}' is lost: {error}")
            return True
        core_of(self.replies).refused -= 1  # it is not lost
        return False

    def _count_lost(self, answer: _Answer) -> None:
        self.at_work.pop(answer.request_id, None)
        core_of(self.replies).refused += 1

    def _take(self, request: Request) -> None:
        request_id = RequestId(request.client, request.number)
        if request.body is not None:
            if self._begin(request_id):
                self._on_request(request.body, request_id)
        elif request_id not in self.at_work:
            self._deny(request_id)

    async def _take_async(self, request: Request) -> None:
        request_id = RequestId(request.client, request.number)
        if request.body is not None:
            if self._begin(request_id):
                await self._on_request(request.body, request_id)
        elif request_id not in self.at_work:
            self._deny(request_id)

    def _begin(self, request_id: RequestId) -> bool:
        """Note a taken request; returns whether to carry it out."""
        self._taken += 1
        if self.skip(request_id):
            return False
        if len(self.at_work) >= _MOST_AT_WORK:
            del self.at_work[next(iter(self.at_work))]
        self.at_work[request_id] = None
        return True

    def _deny(self, request_id: RequestId) -> None:
        """Answer a client's question about an unknown call: the request, or the answer, was lost with
        busd."""
        with suppress(BusError):
            self.replies.publish_encoded(self.support.encode_denial(*request_id))

    def end(self, reason: BusError) -> None:
        if self._work is not None:
            self._work.end()

    def _warn_of_size(self, error: PayloadTooLarge) -> None:
        warn(self.logger, f"no answer of service '{self.service_name}' to one request: {error}")


class _Work:
    """Calls a user's callback for each request: a `def` at once, an `async def` concurrently."""

    def __init__(
        self, server: ServerCore, callback: Callable[..., Any], on_error: Callable[[BaseException], None]
    ) -> None:
        self._server = server
        self._callback = callback
        self._on_error = on_error
        self._gives_response = takes_info(callback)  # ROS's form: (request, response) -> response
        self._places = asyncio.Semaphore(_MOST_AT_ONCE)
        self._tasks: set[asyncio.Task[None]] = set()
        self.on_request: Callable[[Any, RequestId], Any] = self._start if is_async(callback) else self._call

    def end(self) -> None:
        """Cancel running callbacks, because no client would receive the answers."""
        if self._tasks:
            for task in self._tasks - {asyncio.current_task()}:
                task.cancel()

    def _call(self, request: Any, request_id: RequestId) -> None:
        try:
            self._server.answer(request_id, self._callback(*self._arguments(request)))
        except Exception as error:
            self._server.refuse(request_id, error)
            raise

    async def _start(self, request: Any, request_id: RequestId) -> None:
        await self._places.acquire()
        if self._server.skip(request_id):
            self._places.release()
            return
        name = f"a call of {self._server.service_name}"
        task = asyncio.create_task(self._run(request, request_id), name=name)
        self._tasks.add(task)
        task.add_done_callback(self._forget)

    def _forget(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._places.release()

    async def _run(self, request: Any, request_id: RequestId) -> None:
        try:
            response = await call_async(self._callback, *self._arguments(request))
            self._server.answer(request_id, response)
        except Exception as error:
            self._server.refuse(request_id, error)
            self._on_error(error)
        if self._server.sending is not None:  # the call keeps its place until no answer waits
            await asyncio.wait({self._server.sending})

    def _arguments(self, request: Any) -> tuple[Any, ...]:
        return (request, self._server.type.Response()) if self._gives_response else (request,)


def _text_of(error: Exception) -> str:
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:  # its __str__ has failed
        return type(error).__name__

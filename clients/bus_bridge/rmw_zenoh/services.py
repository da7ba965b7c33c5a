"""Services of ROS 2 on zenoh: servers and clients of ours, as queryables and queries.

A request is the payload of a query, and its attachment has the client's gid and the request's number. The
answer repeats the number and the gid.
"""

import asyncio
import time
from collections.abc import Callable, Mapping
from typing import Final

from bus.qos import QoSProfile
from bus_bridge.engine import LocalNode
from bus_bridge.errors import BridgeError
from bus_bridge.rmw_zenoh import attachment
from bus_bridge.rmw_zenoh.graph import ServiceKind
from bus_bridge.rmw_zenoh.keys import Kind, data_key, gid_of
from bus_bridge.rmw_zenoh.session import Asking, Question, RosSession
from bus_bridge.ros2.calling import CallingClient
from bus_bridge.ros2.calls import NoServer, RequestId, Response
from bus_bridge.ros2.service_types import ServiceTypes
from bus_bridge.ros2.turns import TurnsOfServices

__all__ = ["QOS", "RosClient", "RosServer", "RosServices"]

QOS: Final = QoSProfile(10)
"""The profile that servers and clients announce, as in ROS 2."""
_MOST_BYTES: Final = 64 << 20
"""Requests to one server of ours: at most so many bytes without an answer, and between zenoh's thread and the
loop."""
_MOST_OF_CLIENT: Final = 1000
"""Requests of one far client without an answer: without this limit one could shut out the others."""

_OF_RESULTS: Final = "/_action/get_result/"

MakeToken = Callable[[LocalNode, Kind, str, str, str, QoSProfile], str]
"""Makes the token of an endpoint from its node, kind, topic, type, hash and profile."""
FindServers = Callable[[ServiceKind], Mapping[bytes, str]]
"""The present servers of a kind: their sessions, by gid."""


class RosServices:
    """All our servers and clients in a domain. Use it on its event loop only."""

    def __init__(
        self,
        session: RosSession,
        domain: int,
        make_token: MakeToken,
        find_servers: FindServers,
        warn: Callable[[str], None],
    ) -> None:
        self.session = session
        self.domain = domain
        self.make_token = make_token
        self.find_servers = find_servers
        self.warn = warn
        self._clients: dict[RosClient, None] = {}
        self._servers: dict[RosServer, None] = {}
        self.turns = TurnsOfServices()

    def for_end(self, node: LocalNode, types: ServiceTypes) -> "_OfEnd":
        """As `CallCarrier`."""
        return _OfEnd(self, node, types)

    def add(self, end: "RosServer | RosClient") -> None:
        if isinstance(end, RosClient):
            self._clients[end] = None
        else:
            self._servers[end] = None

    def forget(self, end: "RosServer | RosClient") -> None:
        """An end of a service was closed."""
        if isinstance(end, RosClient):
            self._clients.pop(end, None)
        else:
            self._servers.pop(end, None)

    def publisher_gone(self, gid: bytes) -> None:
        """A far endpoint has gone: a client, whose requests need no answer any more, or a server."""
        for server in list(self._servers):
            server.client_gone(gid)
        for client in list(self._clients):
            client.server_gone()

    def close(self) -> None:
        """End everything. Calls without an answer fail. A second call has no effect."""
        for client in list(self._clients):
            client.close()
        for server in list(self._servers):
            server.close()


class _OfEnd:
    """The services of one node, with the types of one service."""

    def __init__(self, services: RosServices, node: LocalNode, types: ServiceTypes) -> None:
        self.warn = services.warn
        self._services = services
        self._node = node
        self._types = types

    def serve(
        self,
        service: str,
        type_name: str,
        on_request: Callable[[RequestId, bytes], None],
        user_data: bytes = b"",
    ) -> "RosServer":
        return RosServer(self._services, self._node, service, self._types, on_request)

    def make_client(self, service: str, type_name: str, user_data: bytes = b"") -> "RosClient":
        return RosClient(self._services, self._node, service, self._types)


class RosServer:
    """A service that we offer."""

    def __init__(
        self,
        services: RosServices,
        node: LocalNode,
        service: str,
        types: ServiceTypes,
        on_request: Callable[[RequestId, bytes], None],
    ) -> None:
        self.faulty = 0
        """Requests without an attachment or a payload."""
        self.refused = 0
        """Requests while too many others were without an answer."""
        self.left_out = 0
        """Requests without room between zenoh's thread and the loop. Only that thread writes it."""
        self._services = services
        self._service = service
        self._on_request = on_request
        self._key = data_key(services.domain, service, types.type_name, types.type_hash)
        self._open: dict[RequestId, Question] = {}
        self._bytes = 0
        """The size of the requests in `_open`: zenoh keeps them."""
        self._is_closed = False
        session = services.session
        self._source = session.source(self._take, _MOST_BYTES, self._leave_out, keeps_oldest=True)
        self._queryable = session.serve(self._key, self._source)
        token = services.make_token(node, "SS", service, types.type_name, types.type_hash, QOS)
        self._gid = gid_of(token)
        self._token = session.token(token)
        services.add(self)

    @property
    def guids(self) -> tuple[bytes, bytes]:
        return self._gid, self._gid

    @property
    def waiting(self) -> int:
        """The number of requests without an answer."""
        return len(self._open)

    def answer(self, request: RequestId, cdr: bytes) -> bool:
        question = self._pop(request)
        if question is None:
            return False
        head = attachment.write(request.number, time.time_ns(), request.client)
        # In a thread: zenoh waits if the link has no room.
        self._services.session.sending.add(lambda: question.reply(self._key, cdr, head), len(cdr))
        return True

    def drop(self, request: RequestId) -> None:
        question = self._pop(request)
        if question is not None:
            question.drop()

    def client_gone(self, gid: bytes) -> None:
        """A client has gone: nothing waits for its answers any more."""
        for request in [one for one in self._open if one.client == gid]:
            self.drop(request)

    def close(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self._token.undeclare()
            self._queryable.undeclare()
            self._source.close()
            for request in list(self._open):
                self.drop(request)
            self._services.forget(self)

    def _take(self, question: Question) -> None:
        head = attachment.read(question.attachment)
        if head is None or not question.payload:
            self.faulty += 1
            question.drop()
            return
        request = RequestId(head.gid, head.number, head.gid)
        if request in self._open:
            question.drop()
            return
        if why := self._why_refused(head.gid, len(question.payload)):
            self.refused += 1
            self._services.warn(
                f"{why} wait for answers of {self._service}, which is the limit: further ones are ignored"
            )
            question.drop()
            return
        self._bytes += len(question.payload)
        self._open[request] = question
        self._on_request(request, question.payload)

    def _leave_out(self, question: Question) -> None:  # in zenoh's thread
        self.left_out += 1
        question.drop()

    def _pop(self, request: RequestId) -> Question | None:
        question = self._open.pop(request, None)
        if question is not None:
            self._bytes -= len(question.payload)
        return question

    def _why_refused(self, client: bytes, size: int) -> str:
        if self._open and self._bytes + size > _MOST_BYTES:
            return f"{_MOST_BYTES >> 20} MiB of requests in ROS 2"
        if len(self._open) >= _MOST_OF_CLIENT and self._waiting_of(client) >= _MOST_OF_CLIENT:
            return f"{_MOST_OF_CLIENT:,} requests of a client in ROS 2"
        return ""

    def _waiting_of(self, client: bytes) -> int:
        return sum(one.client == client for one in self._open)


class RosClient(CallingClient["asyncio.Future[Response]"]):
    """A client of ours."""

    def __init__(self, services: RosServices, node: LocalNode, service: str, types: ServiceTypes) -> None:
        self._kind = ServiceKind(service, types.type_name, types.type_hash)
        key = data_key(services.domain, *self._kind)
        super().__init__(service, services.turns.find(key, is_of_results=_OF_RESULTS in key))
        self.faulty = 0
        """Answers without an attachment, or with another call's attachment."""
        self._services = services
        token = services.make_token(node, "SC", *self._kind, QOS)
        self._gid = gid_of(token)
        self._number = 0
        self._asking = Asking(services.session, key)
        self._token = services.session.token(token)
        services.add(self)

    @property
    def guids(self) -> tuple[bytes, bytes]:
        return self._gid, self._gid

    @property
    def is_ready(self) -> bool:
        """Whether a server is there, and requests reach it."""
        is_there = not self._is_closed and bool(self._services.find_servers(self._kind))
        return is_there and self._asking.is_matched

    def server_gone(self) -> None:
        """A server may have gone: without any, calls get no answer."""
        if not self._services.find_servers(self._kind):
            self._fail("its server has gone")

    def close(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self._fail("the client is closed")
            self._turns.leave(self)
            self._token.undeclare()
            self._asking.undeclare()
            self._services.forget(self)

    async def _ask(self, cdr: bytes) -> Response:
        if self._is_closed or not self._services.find_servers(self._kind):
            raise NoServer(f"no server of {self._name}")
        self._number += 1
        number = self._number
        future: asyncio.Future[Response] = asyncio.get_running_loop().create_future()
        self._calls[number] = future

        def on_answer(payload: bytes, head: bytes, error: str, session: str) -> None:
            found = attachment.read(head)
            if future.done():
                return
            if error:
                future.set_exception(BridgeError(f"a call of {self._name} failed: {error}"))
            elif found is None or (found.number, found.gid) != (number, self._gid):
                self.faulty += 1
            else:
                future.set_result(Response(payload, self._server_in(session)))

        def on_end() -> None:
            is_there = self._services.find_servers(self._kind)
            self._no_answer(future, "its server sent none" if is_there else "its server has gone")

        head = attachment.write(number, time.time_ns(), self._gid)
        give_up = self._asking.ask(cdr, head, on_answer, on_end)
        try:
            return await future
        finally:
            del self._calls[number]
            give_up()

    def _server_in(self, session: str) -> bytes:
        """The gid of the server that has answered: zenoh only says in which session it is."""
        servers = self._services.find_servers(self._kind)
        return next((gid for gid, one in servers.items() if one == session), next(iter(servers), b""))

    def _fail(self, why: str) -> None:
        for future in self._calls.values():
            self._no_answer(future, why)

    def _no_answer(self, future: "asyncio.Future[Response]", why: str) -> None:
        if not future.done():
            future.set_exception(NoServer(f"a call of {self._name} gets no answer: {why}"))

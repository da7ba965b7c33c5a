"""Services of ROS 2 over RTPS: our servers and clients in a DDS domain, and those of other programs.

Owns: the two topics of each service, the identity of each call, and when a call can be made. Payloads are
CDR. Must not know: busd's names for services, and how the bus carries calls.

A call goes to one server, and only if the server's endpoints have answered both of ours. Otherwise a server
could get a request before it knows the reader for the answer; Fast DDS drops the answer then.
"""

import asyncio
from collections import defaultdict
from collections.abc import Callable
from typing import Final, NamedTuple

from bus_bridge.dds.names import MARK, service_to_dds, service_types_to_dds, user_data_of
from bus_bridge.dds.service_identity import (
    Sample,
    read_answer,
    read_request,
    write_answer,
    write_request,
)
from bus_bridge.engine import LocalNode
from bus_bridge.ros2.calling import CallingClient
from bus_bridge.ros2.calls import NoServer, RequestId, Response
from bus_bridge.ros2.service_types import ServiceTypes
from bus_bridge.ros2.turns import TurnsOfServices
from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.ids import PREFIX_BYTES, is_writer_id
from bus_bridge.rtps.parameters import RtpsError
from bus_bridge.rtps.reach import Reach
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.running import RunningParticipant

__all__ = ["ServiceClient", "ServiceServer", "Services"]

_LOOPBACK: Final = Reach()
_REQUESTS, _REPLIES = "rq/", "rr/"
_OF_RESULTS: Final = "/_action/get_resultRequest"
_MOST_OF_CLIENT: Final = 1000
"""Requests of one far client without an answer: without this limit one could shut out the others."""
_MOST_EARLY: Final = 100
"""Clients with answers that wait for their reader's announcement, and such answers of one client."""


class _Topics(NamedTuple):
    requests: str
    replies: str
    request_type: str
    response_type: str


class Services:
    """All our servers and clients in one DDS domain. Use it on its event loop only.

    Endpoints of other busds are not used: they have a mark in USER_DATA. `warn` is called with texts for the
    user; a text may come again. `on_gone` is called with the GUID of each far endpoint that has gone. Raises
    BridgeError like RunningParticipant.
    """

    def __init__(
        self,
        domain: int,
        warn: Callable[[str], None],
        on_gone: Callable[[bytes], object] = lambda guid: None,
        *,
        reach: Reach = _LOOPBACK,
        user_data: bytes = b"enclave=/;",
    ) -> None:
        self.warn = warn
        self._on_gone = on_gone
        self._clients: set[ServiceClient] = set()
        self._servers: set[ServiceServer] = set()
        self._vendors: dict[bytes, bytes] = {}
        """Vendors of far endpoints, by GUID."""
        self.turns = TurnsOfServices()
        self.participant = RunningParticipant(domain, self, _is_of_service, reach=reach, user_data=user_data)

    def for_end(self, node: LocalNode, types: ServiceTypes) -> "Services":
        """As `CallCarrier`: nodes don't matter here."""
        return self

    def serve(
        self,
        service: str,
        type_name: str,
        on_request: Callable[[RequestId, bytes], None],
        user_data: bytes = b"",
    ) -> "ServiceServer":
        """Offer a service. `on_request` is called with the id and the CDR of each request."""
        server = ServiceServer(self, _topics(service, type_name), on_request, user_data)
        self._servers.add(server)
        return server

    def make_client(self, service: str, type_name: str, user_data: bytes = b"") -> "ServiceClient":
        """Make a client of a service."""
        client = ServiceClient(self, _topics(service, type_name), user_data)
        self._clients.add(client)
        return client

    def vendor_of(self, guid: bytes) -> bytes:
        """The vendor of the participant of a far endpoint."""
        return self._vendors.get(guid, b"")

    def close(self) -> None:
        """End everything. Calls without an answer fail. A second call has no effect."""
        for client in list(self._clients):
            client.close()
        for server in list(self._servers):
            server.close()
        self.participant.close()

    def forget(self, end: "ServiceServer | ServiceClient") -> None:
        """An end of a service was closed."""
        if isinstance(end, ServiceClient):
            self._clients.discard(end)
        else:
            self._servers.discard(end)

    # --- news of the participant

    def participant_added(self, data: ParticipantData) -> None:
        """Its endpoints decide."""

    def participant_removed(self, prefix: bytes) -> None:
        """Its endpoints were removed before."""

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        self._vendors[endpoint.guid] = vendor
        if endpoint.kind == "reader" and endpoint.topic.startswith(_REPLIES):
            asyncio.get_running_loop().call_soon(self._reader_added, endpoint.guid)

    def _reader_added(self, guid: bytes) -> None:
        """A reader of answers was announced, and is matched now."""
        for server in list(self._servers):
            server.reader_matched(guid)

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        self._vendors.pop(endpoint.guid, None)
        for client in list(self._clients):
            client.endpoint_removed(endpoint.guid)
        for server in list(self._servers):
            server.endpoint_removed(endpoint.guid)
        self._on_gone(endpoint.guid)


class ServiceServer:
    """A service that we offer; made by `Services.serve`."""

    def __init__(
        self,
        services: Services,
        topics: _Topics,
        on_request: Callable[[RequestId, bytes], None],
        user_data: bytes,
    ) -> None:
        self.faulty = 0
        """Requests without an identity."""
        self.refused = 0
        """Requests of clients that had too many others without an answer."""
        self._services = services
        self._participant = services.participant
        self._on_request = on_request
        self._name = topics.requests
        self._open: defaultdict[bytes, dict[RequestId, None]] = defaultdict(dict)
        """Requests without an answer, by GUID of their writer."""
        self._unmatched: dict[bytes, list[Sample]] = {}
        """Answers for readers that have not been announced yet, by GUID of the reader, or of the writer of
        the request if that named no reader."""
        # The writer of answers first: a client that sees the reader may ask at once.
        self._writer = self._participant.add_writer(topics.replies, topics.response_type, user_data=user_data)
        self._reader = self._participant.add_reader(
            topics.requests, topics.request_type, self._arrived, user_data=user_data
        )
        self._is_closed = False

    @property
    def guids(self) -> tuple[bytes, bytes]:
        """The GUIDs of its reader and its writer."""
        return self._reader.guid, self._writer.guid

    @property
    def waiting(self) -> int:
        """The number of requests without an answer."""
        return sum(map(len, self._open.values()))

    def answer(self, request: RequestId, cdr: bytes) -> bool:
        """Answer a request; returns False if it has an answer, or if its client has gone."""
        if self._is_closed or not self._remove(request):
            return False
        sample, client = write_answer(request, cdr), request.reader or request.writer
        readers = self._readers_of(client)
        for reader in readers:
            self._write(reader, sample)
        if not readers:
            self._keep(client, sample)
        return True

    def drop(self, request: RequestId) -> None:
        """There will be no answer: ROS 2 has none that says that a request failed."""
        self._remove(request)

    def close(self) -> None:
        """Withdraw the service. A second call has no effect."""
        if not self._is_closed:
            self._is_closed = True
            self._open.clear()
            self._unmatched.clear()
            self._participant.remove(self._reader)
            self._participant.remove(self._writer)
            self._services.forget(self)

    def endpoint_removed(self, guid: bytes) -> None:
        """A client has gone: nothing waits for its answers any more."""
        self._unmatched.pop(guid, None)
        self._open.pop(guid, None)
        for requests in list(self._open.values()):
            for request in [one for one in requests if one.client == guid]:
                self._remove(request)

    def reader_matched(self, guid: bytes) -> None:
        """A client's reader may be matched now: send the answers that wait for it."""
        for client in [one for one in self._unmatched if guid in self._readers_of(one)]:
            for sample in self._unmatched.pop(client):
                self._write(guid, sample)

    def _remove(self, request: RequestId) -> bool:
        """Whether it was without an answer until now."""
        requests = self._open.get(request.writer, {})
        if request not in requests:
            return False
        del requests[request]
        if not requests:
            del self._open[request.writer]
        return True

    def _readers_of(self, client: bytes) -> list[bytes]:
        """The matched reader with that GUID; for the GUID of a writer, all readers of its participant.

        Readers of other participants may be of another middleware, which can't read the answer.
        """
        if is_writer_id(client):
            return [guid for guid in self._writer.matched if _is_same(guid, client)]
        return [client] if client in self._writer.matched else []

    def _keep(self, client: bytes, sample: Sample) -> None:
        """Keep an answer until its reader is announced: the announcement may be slower than the request."""
        kept = self._unmatched.setdefault(client, [])
        if len(kept) < _MOST_EARLY:
            kept.append(sample)
        if len(self._unmatched) > _MOST_EARLY:
            del self._unmatched[next(iter(self._unmatched))]

    def _write(self, reader: bytes, sample: Sample) -> None:
        self._participant.write(self._writer, sample.payload, inline=sample.inline, to=reader)

    def _arrived(self, arrived: Arrived) -> None:
        try:
            request, cdr = read_request(arrived, self._services.vendor_of(arrived.writer))
        except RtpsError:
            self.faulty += 1
            return
        if len(self._open.get(request.writer, ())) >= _MOST_OF_CLIENT:
            self.refused += 1
            self._services.warn(
                f"{_MOST_OF_CLIENT:,} requests of a client in ROS 2 wait for answers on {self._name}, "
                "which is the limit: further ones of it are ignored"
            )
            return
        self._open[request.writer][request] = None
        self._on_request(request, cdr)


class _Server(NamedTuple):
    """A far server: the GUIDs of its reader of requests, and of its writer of answers."""

    reader: bytes
    writer: bytes


class _Call(NamedTuple):
    """A call that was sent, to that server."""

    answer: "asyncio.Future[Response]"
    server: _Server


class ServiceClient(CallingClient[_Call]):
    """A client of a service; made by `Services.make_client`.

    An answer that comes after the call was given up counts as late.
    """

    def __init__(self, services: Services, topics: _Topics, user_data: bytes) -> None:
        requests = topics.requests
        super().__init__(
            requests, services.turns.find(requests, is_of_results=requests.endswith(_OF_RESULTS))
        )
        self.faulty = 0
        """Answers without an identity."""
        self.late = 0
        """Answers to calls that were given up, or had an answer."""
        self._services = services
        self._participant = services.participant
        self._reader = self._participant.add_reader(
            topics.replies, topics.response_type, self._arrived, user_data=user_data
        )
        self._writer = self._participant.add_writer(requests, topics.request_type, user_data=user_data)

    @property
    def guids(self) -> tuple[bytes, bytes]:
        """The GUIDs of its reader and its writer."""
        return self._reader.guid, self._writer.guid

    @property
    def is_ready(self) -> bool:
        """Whether a server is there, and knows this client."""
        return self._find_server() is not None

    def close(self) -> None:
        """End the client: its calls fail. A second call has no effect."""
        if not self._is_closed:
            self._is_closed = True
            self._fail(list(self._calls), "the client is closed")
            self._turns.leave(self)
            self._participant.remove(self._writer)
            self._participant.remove(self._reader)
            self._services.forget(self)

    def endpoint_removed(self, guid: bytes) -> None:
        """A server may have gone: calls to it get no answer."""
        gone = [number for number, (_, server) in self._calls.items() if guid in server]
        self._fail(gone, "its server has gone")

    async def _ask(self, cdr: bytes) -> Response:
        server = None if self._is_closed else self._find_server()
        if server is None:
            raise NoServer(f"no server of {self._name}")
        assert self._writer.writer is not None
        number = self._writer.writer.last + 1
        vendor = self._services.vendor_of(server.reader)
        sample = write_request(cdr, self._reader.guid, self._writer.guid, number, vendor)
        future: asyncio.Future[Response] = asyncio.get_running_loop().create_future()
        self._calls[number] = _Call(future, server)
        try:
            self._participant.write(self._writer, sample.payload, inline=sample.inline, to=server.reader)
            return await future
        finally:
            self._calls.pop(number, None)

    def _fail(self, numbers: list[int], why: str) -> None:
        for number in numbers:
            future, _ = self._calls.pop(number)
            if not future.done():
                future.set_exception(NoServer(f"a call of {self._name} gets no answer: {why}"))

    def _find_server(self) -> _Server | None:
        reader, writer = self._reader.reader, self._writer.writer
        assert reader is not None and writer is not None
        answering = {guid[:PREFIX_BYTES]: guid for guid in self._reader.matched if reader.is_following(guid)}
        for guid in reversed(self._writer.matched):  # an older one may be dead before its lease ends
            prefix = guid[:PREFIX_BYTES]
            if prefix in answering and writer.has_answered(guid):
                return _Server(guid, answering[prefix])
        return None

    def _arrived(self, arrived: Arrived) -> None:
        vendor = self._services.vendor_of(arrived.writer)
        try:
            found = read_answer(arrived, self._reader.guid, self._writer.guid, vendor)
        except RtpsError:
            self.faulty += 1
            return
        if found is None:
            return
        number, cdr = found
        future, server = self._calls.get(number, (None, None))
        if future is None or server is None or future.done() or not _is_same(arrived.writer, server.writer):
            self.late += 1
            return
        future.set_result(Response(cdr, arrived.writer))


def _is_same(one: bytes, other: bytes) -> bool:
    """Whether both are of one participant: nothing says which writer belongs to which reader of a process."""
    return one[:PREFIX_BYTES] == other[:PREFIX_BYTES]


def _topics(service: str, type_name: str) -> _Topics:
    return _Topics(*service_to_dds(service), *service_types_to_dds(type_name))


def _is_of_service(endpoint: EndpointData) -> bool:
    return endpoint.topic.startswith((_REQUESTS, _REPLIES)) and MARK not in user_data_of(endpoint.user_data)

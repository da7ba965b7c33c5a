"""The services of this bus in a domain: their ends in ROS 2, and the way of each message of a call.

Owns: the server or client in ROS 2 for each of this bus, and the routes of their messages. Must not know:
discovery, rules, how calls are made in ROS 2.

On this bus, a server or client has a publisher and a subscription: one on the topic of requests, one on the
topic of replies. The bridge announces them one by one. Once it has announced both, there is an end in ROS 2.

    requests of ROS 2 -> `CallsFromRos` -> the route in of the far client's mirror    -> a server of this bus
    its replies       -> the route out of the server's publisher -> `CallsFromRos`    -> ROS 2
    requests here     -> the route out of the client's publisher -> `CallsToRos`      -> a server of ROS 2
    its replies       -> `CallsToRos` -> the route in of the far server's mirror      -> the client
"""

import time
from collections.abc import Callable
from typing import Final, NamedTuple
from weakref import WeakValueDictionary

from bus.names import reply_topic, request_topic, service_of_topic
from bus.schema import MessageSchema
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import FarEndpoint, LocalEndpoint, LocalNode, Reader, Writer
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.calls import CallCarrier
from bus_bridge.ros2.early import Arrived, Early
from bus_bridge.ros2.open_requests import OpenRequests
from bus_bridge.ros2.service_calls import CallsFromRos, CallsToRos
from bus_bridge.ros2.service_types import KnownServices, ServiceTypes

__all__ = ["ServiceWays"]

_EARLY: Final = 1000
_EARLY_BYTES: Final = 16 << 20

Show = Callable[[LocalNode, tuple[bytes, bytes], bool], None]


class _Key(NamedTuple):
    node: int
    service: str
    is_server: bool


class ServiceWays:
    """The services of this bus. It ends with `services`.

    `show` is called with a node, the GUIDs of a reader and a writer of the node in ROS 2, and whether they
    are there now.
    """

    def __init__(self, services: CallCarrier, known: KnownServices, user_data: bytes, show: Show) -> None:
        self._services = services
        self._known = known
        self._user_data = user_data
        self._show = show
        self._ends: dict[_Key, list[_End]] = {}
        self._requests: WeakValueDictionary[str, OpenRequests] = WeakValueDictionary()
        """Requests of ROS 2 to servers of this bus, by service."""
        self._readers: dict[bytes, _Reader] = {}
        """Routes in, by the GUID of the far writer."""
        self._early: Early[bytes, Arrived] = Early(_EARLY, _EARLY_BYTES)
        """Messages that came before the bridge had a route for them."""
        self._reasons: Early[str, Arrived] = Early(_EARLY, _EARLY_BYTES)
        """Messages that no far server has sent, by topic, while no route can bring them: the bus may show a
        client its server before it shows the server's publisher of replies."""

    def announce_publisher(
        self, endpoint: LocalEndpoint, schema: MessageSchema, on_change: Callable[[], None]
    ) -> Writer:
        """As `Engine.announce_publisher`, for a topic of requests or replies."""
        end = self._end_without(endpoint)
        end.publisher = writer = _Writer(end, schema, on_change)
        try:
            self._complete(end)
        except BridgeError:
            writer.close()
            raise
        return writer

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        """As `Engine.announce_subscription`, for a topic of requests or replies."""
        end = self._end_without(endpoint)
        end.subscription = subscription = _Subscription(end, schema)
        try:
            self._complete(end)
        except BridgeError:
            subscription.withdraw()
            raise
        return subscription.withdraw

    def read(self, endpoint: FarEndpoint, on_batch: Callable[[Batch], None]) -> Reader:
        """As `Engine.read`, for a topic of requests or replies."""
        reader = self._readers[endpoint.gid] = _Reader(self, endpoint, on_batch)
        early, lost = self._early.pop(endpoint.gid)
        reader.lost.update({str(reason): count for reason, count in lost.items()})
        reasons, _ = self._reasons.pop(endpoint.topic)
        for payload, time_ns in (*early, *reasons):
            on_batch(Loose([Sample(payload, 0, time_ns)]))
        return reader

    def endpoint_gone(self, guid: bytes) -> None:
        """A far endpoint has gone: its messages have no route any more."""
        self._early.pop(guid)

    def close(self) -> None:
        """End all servers and clients in ROS 2."""
        for ends in list(self._ends.values()):
            for end in list(ends):
                end.publisher = end.subscription = None
                self.dissolve(end)

    # --- for the parts in this file

    def dissolve(self, end: "_End") -> None:
        """An endpoint of an end was withdrawn: it is no longer in ROS 2."""
        if end.calls is not None:
            self._show(end.node, end.guids, False)
            end.calls.close()
            end.calls = None
        ends = self._ends.get(end.key, [])
        other = next((one for one in ends if one is not end and one.fits(end)), None)
        if other is not None:
            other.take_over(end)
        if end.publisher is None and end.subscription is None and end in ends:
            ends.remove(end)
        if not ends:
            self._ends.pop(end.key, None)
        if other is not None:
            try:
                self._complete(other)
            except BridgeError as error:
                self._services.warn(f"{end.key.service} is not carried any more: {error}")

    def reader_closed(self, reader: "_Reader") -> None:
        if self._readers.get(reader.endpoint.gid) is reader:
            del self._readers[reader.endpoint.gid]

    # --- inside

    def _end_without(self, endpoint: LocalEndpoint) -> "_End":
        """The first end of that node and service without an endpoint of this kind, or a new one."""
        service = service_of_topic(endpoint.topic)
        assert service is not None
        is_of_requests = endpoint.topic == request_topic(service)
        key = _Key(endpoint.node.id, service, is_of_requests is (endpoint.kind == "subscription"))
        ends = self._ends.setdefault(key, [])
        for end in ends:
            if getattr(end, endpoint.kind) is None:
                return end
        ends.append(_End(self, key, endpoint.node))
        return ends[-1]

    def _complete(self, end: "_End") -> None:
        """Make the end in ROS 2 if both of its endpoints are announced. Raises BridgeError."""
        if end.publisher is None or end.subscription is None or end.calls is not None:
            return
        schemas = (end.publisher.schema, end.subscription.schema)
        requests, replies = reversed(schemas) if end.key.is_server else schemas
        types = ServiceTypes.of(requests, replies)
        self._known.learn(types)
        end.calls = self._make_calls(end, types)
        self._show(end.node, end.guids, True)
        end.publisher.on_change()

    def _make_calls(self, end: "_End", types: ServiceTypes) -> CallsFromRos | CallsToRos:
        key, service = end.key, end.key.service
        services = self._services.for_end(end.node, types)
        if key.is_server:
            requests = self._requests.setdefault(service, OpenRequests())
            return CallsFromRos(services, service, types, self._deliver, self._user_data, requests)
        topic = reply_topic(service)
        return CallsToRos(
            services,
            service,
            types,
            lambda server, payload: (
                self._deliver(server, payload) if server else self._deliver_reason(topic, payload)
            ),
            self._user_data,
        )

    def _deliver_reason(self, topic: str, payload: bytes) -> None:
        """Deliver a message that says why there is no answer.

        All routes of that topic bring it, because it is true of all servers: a client with several servers
        gives up a call only after each has denied it.
        """
        readers = [one.endpoint.gid for one in self._readers.values() if one.endpoint.topic == topic]
        if not readers:
            self._reasons.put(topic, (payload, time.time_ns()))
        for gid in readers:
            self._deliver(gid, payload)

    def _deliver(self, writer: bytes, payload: bytes) -> None:
        time_ns = time.time_ns()
        reader = self._readers.get(writer)
        if reader is not None:
            reader.on_batch(Loose([Sample(payload, 0, time_ns)]))
        else:
            self._early.put(writer, (payload, time_ns))


class _End:
    """A server or client of this bus, as far as it was announced."""

    def __init__(self, ways: ServiceWays, key: _Key, node: LocalNode) -> None:
        self.ways = ways
        self.key = key
        self.node = node
        self.publisher: _Writer | None = None
        self.subscription: _Subscription | None = None
        self.calls: CallsFromRos | CallsToRos | None = None
        """Its end in ROS 2."""

    @property
    def guids(self) -> tuple[bytes, bytes]:
        """The GUIDs of its reader and its writer in ROS 2."""
        assert self.calls is not None
        one = self.calls
        return one.server.guids if isinstance(one, CallsFromRos) else one.client.guids

    def fits(self, other: "_End") -> bool:
        """Whether one of them has only the publisher, and the other one only the subscription."""
        halves = {(one.publisher is None, one.subscription is None) for one in (self, other)}
        return halves == {(True, False), (False, True)}

    def take_over(self, other: "_End") -> None:
        """Take the only endpoint of another end. Its former partner has gone."""
        if other.publisher is not None:
            self.publisher, other.publisher = other.publisher, None
            self.publisher.move_to(self)
        elif other.subscription is not None:
            self.subscription, other.subscription = other.subscription, None
            self.subscription.end = self

    def take(self, payload: bytes) -> None:
        """Take a message of its publisher. Raises BridgeError for a wrong one."""
        if isinstance(self.calls, CallsFromRos):
            self.calls.reply(payload)
        elif self.calls is not None:
            self.calls.request(payload)


class _Subscription:
    """The subscription of a server or client."""

    def __init__(self, end: _End, schema: MessageSchema) -> None:
        self.end = end
        self.schema = schema

    def withdraw(self) -> None:
        """A second call has no effect."""
        if self.end.subscription is self:
            self.end.subscription = None
            self.end.ways.dissolve(self.end)


class _Writer:
    """The route out of the publisher of a server or client."""

    def __init__(self, end: _End, schema: MessageSchema, on_change: Callable[[], None]) -> None:
        self.schema = schema
        self.on_change = on_change
        self.lost: dict[str, int] = {}
        self._end: _End | None = end

    @property
    def is_wanted(self) -> bool:
        return self._end is not None

    def move_to(self, end: _End) -> None:
        self._end = end

    def write(self, batch: Batch) -> int:
        if self._end is not None and self._end.calls is None:
            return 0  # until the other endpoint is announced
        for sample in batch:
            try:
                if self._end is not None:
                    self._end.take(sample.payload)
            except BridgeError:
                self.lost[DropReason.UNDECODABLE] = self.lost.get(DropReason.UNDECODABLE, 0) + 1
        return batch.count

    def close(self) -> None:
        end, self._end = self._end, None
        if end is not None:
            end.publisher = None
            end.ways.dissolve(end)


class _Reader:
    """The route in of a far client's requests, or of a far server's replies."""

    def __init__(self, ways: ServiceWays, endpoint: FarEndpoint, on_batch: Callable[[Batch], None]) -> None:
        self.endpoint = endpoint
        self.on_batch = on_batch
        self.lost: dict[str, int] = {}
        self._ways = ways

    def taken(self, size: int) -> None:
        """Nothing waits for this: calls have separate limits."""

    def close(self) -> None:
        self._ways.reader_closed(self)

"""The engine for ROS 2 on zenoh: shows nodes and endpoints of this bus as rmw_zenoh does, and the reverse."""

import asyncio
from collections.abc import Callable, Sequence
from itertools import count
from typing import Final, NamedTuple

import msgspec

from bus.base.counted import counted
from bus.names import service_of_topic
from bus.qos import Durability, Liveliness, QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Batch
from bus_bridge.engine import (
    FarBus,
    FarEndpoint,
    FarSide,
    LinkStatus,
    LocalEndpoint,
    LocalNode,
    Reader,
    RouteRule,
    Writer,
)
from bus_bridge.errors import BridgeError, NotCarried, in_words
from bus_bridge.extras import why_no_rmw_zenoh
from bus_bridge.rmw_zenoh.graph import MOST_TOKENS, RosGraph
from bus_bridge.rmw_zenoh.keys import (
    EndpointToken,
    Kind,
    NodeToken,
    all_tokens,
    data_key,
    write_endpoint,
    write_node,
)
from bus_bridge.rmw_zenoh.options import RmwZenohOptions, check
from bus_bridge.rmw_zenoh.reading import Intakes, RosReader
from bus_bridge.rmw_zenoh.services import RosServices
from bus_bridge.rmw_zenoh.session import RosSession
from bus_bridge.rmw_zenoh.writing import RosWriter
from bus_bridge.ros2.known_types import KnownType, KnownTypes
from bus_bridge.ros2.route_out import RouteOut
from bus_bridge.ros2.service_types import KnownServices
from bus_bridge.ros2.service_ways import ServiceWays
from bus_bridge.zenoh.links import Links
from bus_bridge.zenoh.session import Declared

__all__ = ["RmwZenohEngine"]

_LOOK_S: Final = 1.0


class _Node(NamedTuple):
    said: NodeToken
    token: Declared


class RmwZenohEngine:
    """An Engine. `bus`: the id of this bus. It marks our tokens for the bridges of other busds.

    A domain is one far bus, `rmw_zenoh0` for domain 0: sessions are processes, not buses. Raises BridgeError
    for impossible or forbidden options, and if a package is missing.
    """

    name = "ros2"
    has_numbers = True

    def __init__(self, bus: str, options: RmwZenohOptions) -> None:
        if why := why_no_rmw_zenoh():
            raise BridgeError(why)
        self._warnings = check(options)
        self._options = options
        self._own = bus
        self._domain = options.domain
        self.only_bus = f"rmw_zenoh{options.domain}"
        self._numbers = count()
        self._nodes: dict[int, _Node] = {}
        self._writers: set[RouteOut] = set()
        self._session: RosSession | None = None
        self._watch: Declared | None = None
        self._looking: asyncio.Task[None] | None = None
        self._refusal = ""
        self._lost_tokens = 0
        self._closing: asyncio.Task[None] | None = None

    async def open(self, far: FarSide) -> None:
        self._far = far
        session = RosSession(self._options.links, self._see_fault)
        await session.open()
        self._session = session
        for text in self._warnings:
            far.warn(text)
        self.types = KnownTypes()
        self._known_services = KnownServices()
        self._links = Links(self._options.links, session, far.warn, wants_routers=True)
        self._intakes = Intakes(session, far.warn)
        self._graph = RosGraph(
            self.only_bus,
            session.zenoh_id,
            self.types,
            self._known_services,
            far,
            self._intakes.publisher_came,
            self._publisher_gone,
        )
        self._services = RosServices(
            session, self._domain, self._make_token, self._graph.servers_of, far.warn
        )
        self._ways = ServiceWays(self._services, self._known_services, b"", lambda node, guids, there: None)
        far.bus_added(FarBus(self.only_bus))
        self._tokens = session.source(self._see_token, 2 * MOST_TOKENS, self._lose_token, keeps_oldest=True)
        self._watch = session.watch_tokens(all_tokens(self._domain), self._tokens)
        self._looking = asyncio.get_running_loop().create_task(self._poll())

    async def close(self) -> None:
        session = self._end()
        if session is not None:
            await session.close()

    # --- from this bus to the far side

    def announce_node(self, node: LocalNode) -> None:
        if self._session is None or node.id in self._nodes:
            return
        number = str(next(self._numbers))
        said = NodeToken(self._session.zenoh_id, number, node.namespace, node.name, is_of_busd=True)
        token = self._session.token(write_node(self._domain, said, self._own))
        self._nodes[node.id] = _Node(said, token)

    def withdraw_node(self, node: LocalNode) -> None:
        gone = self._nodes.pop(node.id, None)
        if gone is not None:
            gone.token.undeclare()

    def announce_publisher(
        self,
        endpoint: LocalEndpoint,
        schema: MessageSchema,
        rule: RouteRule,
        on_change: Callable[[], None],
    ) -> Writer:
        session = self._joined()
        if service_of_topic(endpoint.topic) is not None:
            writer = self._ways.announce_publisher(endpoint, schema, on_change)
            self._graph.types_changed()
            return writer
        known = self._learn(schema)
        if endpoint.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self._far.warn(
                "ROS 2 sees publishers with manual liveliness as automatic: their assertions do not cross"
            )
        kind = endpoint.topic, known.codec.type_name, known.codec.type_hash
        made = RosWriter(
            session,
            data_key(self._domain, *kind),
            self._make_token(endpoint.node, "MP", *kind, endpoint.qos),
            known,
            endpoint.qos,
            rule.priority,
            on_change,
            self._writers.discard,
        )
        self._writers.add(made)
        return made

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        session = self._joined()
        if service_of_topic(endpoint.topic) is not None:
            withdraw = self._ways.announce_subscription(endpoint, schema)
            self._graph.types_changed()
            return withdraw
        known = self._learn(schema)
        kind = endpoint.topic, known.codec.type_name, known.codec.type_hash
        # A subscription first: a publisher may publish once it sees the token.
        intake = self._intakes.hold(data_key(self._domain, *kind), known)
        token = session.token(self._make_token(endpoint.node, "MS", *kind, _asked(endpoint.qos)))

        def withdraw_both() -> None:
            token.undeclare()
            intake.release()

        return withdraw_both

    # --- from the far side to this bus

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        known = self.types if service_of_topic(endpoint.topic) is None else self._known_services
        return known.schema_of(endpoint.type_name, endpoint.type_hash)

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool = False,
    ) -> Reader:
        # Each reader asks for kept messages, whatever `restores` is.
        self._joined()
        if service_of_topic(endpoint.topic) is not None:
            return self._ways.read(endpoint, on_batch)
        if endpoint.gid not in self._graph.publishers:
            raise BridgeError(f"the publisher of {endpoint.topic} has left ROS 2's domain {self._domain}")
        known = self._learn(schema)
        key = data_key(self._domain, endpoint.topic, known.codec.type_name, known.codec.type_hash)
        return RosReader(self._intakes.hold(key, known), endpoint, known, on_batch)

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        if announcer:
            self._graph.refuse(announcer)
            asyncio.get_running_loop().call_soon(self._graph.forget_refused)
        elif bus_id == self.only_bus and not self._refusal:
            self._refusal = reason
            session = self._end()
            if session is not None:
                self._closing = asyncio.get_running_loop().create_task(session.close())
            self._far.bus_removed(bus_id, reason)

    def links(self) -> Sequence[LinkStatus]:
        if self._refusal:
            return [LinkStatus(self._address(), "refused", self.only_bus, self._refusal)]
        if self._session is None:
            return []
        sessions, refused = self._graph.sessions, len(self._graph.refused)
        text = counted(sessions, "session") + (f", {refused} refused" if refused else "")
        return [*self._links.status(()), LinkStatus(self._address(), "up", self.only_bus, text)]

    def refusals(self) -> tuple[int, str]:
        """As `Engine.refusals`. Always 0: zenoh does not report refused connections."""
        return 0, ""

    # --- inside

    def _make_token(
        self, node: LocalNode, kind: Kind, topic: str, type_name: str, type_hash: str, qos: QoSProfile
    ) -> str:
        self.announce_node(node)
        said = EndpointToken(self._nodes[node.id].said, kind, topic, type_name, type_hash, qos)
        return write_endpoint(self._domain, said, next(self._numbers), self._own)

    def _learn(self, schema: MessageSchema) -> KnownType:
        known = self.types.learn(schema)
        self._graph.types_changed()
        return known

    def _see_token(self, news: tuple[str, bool]) -> None:
        key, is_there = news
        if self._session is None:
            return
        if is_there:
            self._graph.came(key)
        else:
            self._graph.gone(key)

    def _lose_token(self, news: tuple[str, bool]) -> None:  # in zenoh's thread
        self._lost_tokens += 1

    def _publisher_gone(self, gid: bytes) -> None:
        self._intakes.publisher_gone(gid)
        self._ways.endpoint_gone(gid)
        self._services.publisher_gone(gid)

    async def _poll(self) -> None:
        assert self._session is not None and self._watch is not None
        heard = seen = self._session.link_ends
        while True:
            await asyncio.sleep(_LOOK_S)
            try:
                # As in the engine for zenoh: if a link ends soon after another one began, tokens may be
                # missing. So ask for all of them again after a check without an ended link.
                seen, before = self._session.link_ends, seen
                if heard != seen == before:
                    heard = seen
                    self._watch.renew()
                if self._lost_tokens and self._tokens.is_empty:
                    self._far.warn("ROS 2 announced more than the bridge could read at once: it asks again")
                    self._lost_tokens = 0
                    self._graph.clear()  # a lost piece of news may be that a node has gone
                    self._watch.renew()
                self._intakes.sweep()
                await self._links.check()
            except Exception as error:  # the next round may do better
                self._far.warn(f"a check of the links failed: {in_words(error)}")

    def _see_fault(self, error: Exception) -> None:
        self._far.warn(f"a message of zenoh caused an error in the bridge: {in_words(error)}")

    def _end(self) -> RosSession | None:
        """End everything except the session. None if that was done before."""
        session = self._session
        if session is not None:
            if self._looking is not None:
                self._looking.cancel()
            for writer in list(self._writers):
                writer.close()
            self._ways.close()
            self._services.close()
            self._session = None
        return session

    def _joined(self) -> RosSession:
        if self._session is None:
            raise NotCarried(f"{self._address()} is ignored now: {self._refusal}")
        return self._session

    def _address(self) -> str:
        return f"ROS 2's domain {self._domain} on zenoh"


def _asked(qos: QoSProfile) -> QoSProfile:
    """The profile to announce for a subscription, which may take the best available durability."""
    is_any = qos.durability is Durability.BEST_AVAILABLE
    return msgspec.structs.replace(qos, durability=Durability.VOLATILE) if is_any else qos

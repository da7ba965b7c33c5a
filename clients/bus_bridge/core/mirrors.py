"""Mirrors of far nodes and endpoints on this bus. One task makes and closes them in order.

Owns the mirror nodes, publishers and subscriptions. The task reads the wanted state from the `FarGraph` after
each change. So there is no queue of changes, however many come.
"""

import asyncio
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Iterator
from enum import IntEnum
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import msgspec

from bus.errors import BusError
from bus.events import PublisherEvents, SubscriptionEvents
from bus.graph import Origin
from bus.names import request_topic, service_of_topic
from bus.node import Node
from bus.publisher import Publisher
from bus.qos import Durability, Liveliness, QoSProfile
from bus.schema import MessageSchema
from bus.subscription import Subscription
from bus_bridge.core.exports import Exports, TopicExports, TypedTopic
from bus_bridge.core.far_graph import FarGraph, Mirrored, MirroredNode
from bus_bridge.core.imports import Import
from bus_bridge.core.journal import Journal
from bus_bridge.core.lateness import Lateness
from bus_bridge.core.pasts import Pasts
from bus_bridge.core.schemas import Schemas
from bus_bridge.core.staying import NEVER_S, Retry, Stays
from bus_bridge.engine import Engine
from bus_bridge.errors import in_words

__all__ = ["EndpointMirror", "Mirrors", "NodeMirror"]

T = TypeVar("T")

_AT_ONCE = 64
_CLOSE_S = 1.0


class Stage(IntEnum):
    """The order in which the endpoints of a node get their mirrors.

    A client's subscription for replies is here before its requests arrive. A server's publisher of replies is
    here before it can be asked.
    """

    SUBSCRIPTION = 0
    PUBLISHER = 1
    SERVER = 2
    """Its subscription to requests."""

    @classmethod
    def of(cls, far: Mirrored) -> "Stage":
        if far.far.kind == "publisher":
            return cls.PUBLISHER
        service = service_of_topic(far.topic)
        is_server = service is not None and far.topic == request_topic(service)
        return cls.SERVER if is_server else cls.SUBSCRIPTION


class NodeMirror:
    """The mirror of a far node."""

    def __init__(self, far: MirroredNode) -> None:
        self.far = far
        self.node: Node | None = None
        self.retry = Retry()


class EndpointMirror:
    """The mirror of a far publisher or subscription."""

    def __init__(self, far: Mirrored, node: NodeMirror) -> None:
        self.far = far
        self.node = node
        self.publisher: Publisher[Any] | None = None
        self.subscription: Subscription[Any] | None = None
        self.way: Import | None = None
        """The route in of a publisher's messages."""
        self.route: TopicExports | None = None
        """The route out of messages to a subscription."""
        self.sent_before = 0
        """Messages sent by that route before the subscription existed."""
        self.retry = Retry()
        self.gone_s = 0.0
        """Time since which a transient local publisher is missing on its bus; 0 while it exists."""
        self.is_leaving = False

    @property
    def is_open(self) -> bool:
        return self.publisher is not None or self.subscription is not None

    @property
    def is_publisher(self) -> bool:
        return self.far.far.kind == "publisher"


class Mirrors:
    """Makes and closes all mirrors.

    `make_node(name, namespace, origin)` returns a node, which `Mirrors` opens. `knows` returns whether the
    last graph had an endpoint with this gid. `warn` gets texts for the user.
    """

    def __init__(
        self,
        engine: Engine,
        far: FarGraph,
        exports: Exports,
        schemas: Schemas,
        make_node: Callable[[str, str, Origin], Node],
        knows: Callable[[bytes], bool],
        warn: Callable[[str], None],
        journal: Journal | None = None,
    ) -> None:
        self._engine = engine
        self._knows = knows
        self._far = far
        self._exports = exports
        self._schemas = schemas
        self._make_node = make_node
        self._warn = warn
        self._loop = asyncio.get_running_loop()
        self._nodes: dict[str, NodeMirror] = {}
        self._endpoints: dict[bytes, EndpointMirror] = {}
        self._leaving: dict[bytes, asyncio.Task[None]] = {}
        """Tasks for publishers that have gone but have waiting messages."""
        self._lateness: WeakValueDictionary[tuple[str, ...], Lateness] = WeakValueDictionary()
        """Each clock of messages has one. The routes in hold them."""
        self._pasts = Pasts()
        self._journal = journal
        self._stays = Stays()
        self._is_due = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        schemas.on_found = self.notify

    def __iter__(self) -> Iterator[EndpointMirror]:
        return iter(self._endpoints.values())

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of nodes, publishers and subscriptions that are shown here."""
        publishers = sum(one.publisher is not None for one in self._endpoints.values())
        subscriptions = sum(one.subscription is not None for one in self._endpoints.values())
        return sum(one.node is not None for one in self._nodes.values()), publishers, subscriptions

    def notify(self) -> None:
        """Wake the task: the far graph may have changed."""
        self._is_due.set()

    def bus_added(self, bus: str) -> None:
        """Handle a bus that has come, perhaps again. Call `look` afterwards."""
        self._stays.bus_added(bus, self._loop.time())

    def bus_removed(self, bus: str) -> None:
        """Handle the end of the link to a bus. Call this before `look`."""
        self._stays.bus_removed(bus, self._loop.time())
        for clock in [clock for clock in self._lateness if clock[0] == bus]:
            self._lateness.pop(clock, None)

    async def run(self) -> None:
        """Make and close mirrors until cancelled. Call `close` afterwards."""
        while True:
            await self._is_due.wait()
            self._is_due.clear()
            await self._settle()

    async def close(self) -> None:
        """Close all mirrors. Cancellation: the remaining ones end with the connection."""
        if self._timer is not None:
            self._timer.cancel()
        for task in self._leaving.values():
            task.cancel()
        for mirror in self._endpoints.values():
            if mirror.way is not None:
                mirror.way.end()
        nodes = [one.node for one in self._nodes.values() if one.node is not None]
        await asyncio.gather(*(node.close() for node in nodes), return_exceptions=True)

    # --- one pass over all mirrors

    async def _settle(self) -> None:
        self._take_over_nodes()
        self._take_over_endpoints()
        gone = [one for one in self._endpoints.values() if self._is_to_go(one)]
        gone.sort(key=lambda one: not one.is_publisher)
        await self._each(gone, self._close_endpoint)
        used = {id(one.node) for one in self._endpoints.values()}
        idle = [one for one in self._nodes.values() if self._is_gone(one) and id(one) not in used]
        await self._each(idle, self._close_node)
        for far in self._far.nodes.values():
            self._nodes.setdefault(far.key, NodeMirror(far))
        now_s = self._loop.time()
        closed = [one for one in self._nodes.values() if one.node is None and not self._is_gone(one)]
        await self._each([one for one in closed if one.retry.at_s <= now_s], self._open_node)
        for stage in Stage:
            await self._each(self._missing(stage), self._open_endpoint)
        self._arm()

    async def _each(self, items: Iterable[T], act: Callable[[T], Awaitable[None]]) -> None:
        left = list(items)
        while left:
            await asyncio.gather(*map(act, left[:_AT_ONCE]))
            del left[:_AT_ONCE]

    def _is_gone(self, node: NodeMirror) -> bool:
        return self._far.nodes.get(node.far.key) != node.far

    def _is_to_go(self, mirror: EndpointMirror) -> bool:
        if mirror.is_leaving:
            return False
        if mirror.way is not None and mirror.way.is_broken:
            return True
        if self._far.endpoints.get(mirror.far.far.gid) is mirror.far:
            return False
        return self._stays_until(mirror) <= self._loop.time()

    def _stays_until(self, mirror: EndpointMirror) -> float:
        is_kept = (
            mirror.publisher is not None
            and not self._far.knows(mirror.far.far.gid)
            and mirror.far.far.qos.durability is Durability.TRANSIENT_LOCAL
        )
        if not is_kept:
            return 0.0
        mirror.gone_s = mirror.gone_s or self._loop.time()
        return self._stays.until(mirror.node.far.bus, mirror.gone_s)

    def _take_over_nodes(self) -> None:
        """Let remaining mirrors stand for the nodes that a returned bridge shows now."""
        gone: defaultdict[tuple[object, ...], list[NodeMirror]] = defaultdict(list)
        for one in self._nodes.values():
            if self._is_gone(one):
                gone[one.far.identity].append(one)
        if not gone:
            return
        # Of several nodes with one name, each takes over the mirror that has its endpoints, or the first one.
        owners = {
            far.node.key: self._endpoints[gid].node
            for gid, far in self._far.endpoints.items()
            if gid in self._endpoints
        }
        for key, far in sorted(self._far.nodes.items(), key=lambda one: one[0] not in owners):
            if key not in self._nodes and (left := gone[far.identity]):
                mirror = owners.get(key)
                if mirror not in left:
                    mirror = left[0]
                left.remove(mirror)
                del self._nodes[mirror.far.key]
                mirror.far = far
                mirror.retry.hurry()
                self._nodes[key] = mirror

    def _take_over_endpoints(self) -> None:
        for gid, mirror in self._endpoints.items():
            far = self._far.endpoints.get(gid)
            if far is None or far is mirror.far or mirror.is_leaving or mirror.way is None:
                continue
            # Of several nodes with one name, another one may have taken over the mirror's node.
            node = mirror.node
            is_same = (
                (far.topic, far.qos, far.rule) == (mirror.far.topic, mirror.far.qos, mirror.far.rule)
                and msgspec.structs.replace(far.far, node=mirror.far.far.node) == mirror.far.far
                and far.node.identity == node.far.identity
                and not self._is_gone(node)
            )
            if is_same:
                mirror.far, mirror.gone_s = far, 0.0
                mirror.way.begin_again(far.far, numbering=_numbering(far))

    def _missing(self, stage: Stage) -> list[tuple[EndpointMirror, MessageSchema]]:
        """Endpoints of a stage without a mirror that can get one now."""
        found: list[tuple[EndpointMirror, MessageSchema]] = []
        now_s = self._loop.time()
        unready = {
            far.node.key
            for gid, far in self._far.endpoints.items()
            if Stage.of(far) < stage and self._is_due_first(gid, far)
        }
        for gid, far in self._far.endpoints.items():
            if Stage.of(far) is not stage:
                continue
            mirror = self._endpoints.get(gid)
            if mirror is None:
                node = self._nodes.get(far.node.key)
                if node is None or node.node is None:
                    continue
                mirror = self._endpoints[gid] = EndpointMirror(far, node)
            if mirror.far is not far or mirror.is_open or mirror.retry.at_s > now_s:
                continue
            if mirror.retry.failures and self._knows(gid):  # it has come another way, and still exists
                mirror.retry.fail(now_s)
                continue
            try:
                schema = self._schemas.get(far.far)
            except BusError as error:
                self._fail(mirror, error)
                continue
            if schema is not None and far.node.key not in unready:
                found.append((mirror, schema))
        return found

    def _is_due_first(self, gid: bytes, far: Mirrored) -> bool:
        """Whether an endpoint must have a mirror before endpoints of later stages of its node.

        It may have come since the mirrors of its stage were made in this pass.
        """
        mirror = self._endpoints.get(gid)
        return mirror is None or mirror.far is not far or not (mirror.is_open or mirror.retry.failures)

    def _arm(self) -> None:
        """Set the timer for the next retry, or for the end of a mirror that stays for a while."""
        now_s = self._loop.time()
        times = [one.retry.at_s for one in self._nodes.values()]
        times += [one.retry.at_s for one in self._endpoints.values()]
        times += [self._stays.least(one.gone_s) for one in self._endpoints.values() if one.gone_s]
        due_s = min((one for one in times if one > now_s), default=NEVER_S)
        due_s = min(due_s, self._stays.next_end(now_s))
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if due_s < NEVER_S:
            self._timer = self._loop.call_later(due_s - now_s + 0.01, self.notify)

    # --- single steps

    async def _open_node(self, mirror: NodeMirror) -> None:
        if self._is_gone(mirror):
            return
        far = mirror.far
        try:
            node = self._make_node(far.name, far.namespace, Origin(self._engine.name, far.bus, far.via))
            await node.open()
        except Exception as error:
            mirror.retry.fail(self._loop.time())
            self._warn(f"node {_full_name(far)} of '{far.bus}' can't be shown here: {in_words(error)}")
            return
        mirror.node = node
        mirror.retry.succeed()

    async def _close_node(self, mirror: NodeMirror) -> None:
        if self._nodes.get(mirror.far.key) is mirror:
            del self._nodes[mirror.far.key]
        node, mirror.node = mirror.node, None
        if node is not None:
            await self._within_bounds(node.close())

    async def _open_endpoint(self, one: tuple[EndpointMirror, MessageSchema]) -> None:
        mirror, schema = one
        far, node = mirror.far, mirror.node.node
        if node is None or self._far.endpoints.get(far.far.gid) is not far:
            return
        try:
            if mirror.is_publisher:
                await self._open_publisher(mirror, schema, node)
            else:
                await self._open_subscription(mirror, schema, node)
        except Exception as error:
            self._fail(mirror, error)
        else:
            mirror.retry.succeed()

    async def _open_publisher(self, mirror: EndpointMirror, schema: MessageSchema, node: Node) -> None:
        far = mirror.far

        def notify(change: object) -> None:
            if mirror.way is not None:
                mirror.way.on_matched()

        publisher = await node.create_publisher(
            schema,
            far.topic,
            self._offer(far),
            events=PublisherEvents(matched=notify),
            gid=far.far.gid,
        )

        def on_fault(text: str) -> None:
            self._warn(f"messages on '{far.topic}' of '{far.node.bus}' don't come in: {text}")
            if mirror.way is not None and mirror.way.is_broken:
                self.notify()

        lateness = self._lateness.setdefault(far.node.clock, Lateness())
        past = self._pasts.take(far.far.gid, self._loop.time())
        if past is None and self._journal is not None:
            past = self._journal.take(far.far.gid)
        mirror.publisher = publisher
        mirror.way = Import(
            self._engine,
            far.far,
            schema,
            publisher,
            lateness,
            on_fault,
            numbering=_numbering(far),
            max_rate_hz=far.rule.max_rate_hz,
        )
        if self._journal is not None and not _numbering(far):
            mirror.way.entry = self._journal.begin(far.far.gid)
        if past is not None:
            mirror.way.resume(past)
        mirror.way.on_matched()

    async def _open_subscription(self, mirror: EndpointMirror, schema: MessageSchema, node: Node) -> None:
        far = mirror.far
        topic = TypedTopic(far.topic, schema.type_name, schema.type_hash)
        route = await self._exports.hold(topic, schema, far.far.gid)
        try:
            subscription = await node.create_subscription(
                schema,
                far.topic,
                far.qos,
                raw=True,
                events=SubscriptionEvents(matched=lambda change: route.matches_changed()),
                gid=far.far.gid,
                # Otherwise the bridge would read publishers mirrored from one far bus for another far bus,
                # although their messages do not go there.
                local_only=route.is_local,
                role="mirror",
            )
        except BaseException:
            await self._exports.release(route, far.far.gid)
            raise
        mirror.subscription, mirror.route, mirror.sent_before = subscription, route, route.sent
        route.mirrors[subscription] = None
        route.matches_changed()

    async def _close_endpoint(self, mirror: EndpointMirror) -> None:
        gid = mirror.far.far.gid
        if not self._is_to_go(mirror):
            return
        mirror.is_leaving = True
        if mirror.subscription is not None and mirror.route is not None:
            mirror.route.mirrors.pop(mirror.subscription, None)
            await self._within_bounds(mirror.subscription.close())
            await self._within_bounds(self._exports.release(mirror.route, gid))
        elif mirror.publisher is not None and mirror.way is not None:
            self._pasts.keep(gid, mirror.way.past(), self._loop.time())
            if mirror.way.waiting:  # others must not wait for them
                self._leaving[gid] = self._loop.create_task(self._leave(gid, mirror), name="leave a topic")
                return
            await mirror.way.finish()
            await self._within_bounds(mirror.publisher.close())
        self._endpoints.pop(gid, None)

    async def _leave(self, gid: bytes, mirror: EndpointMirror) -> None:
        assert mirror.way is not None and mirror.publisher is not None
        try:
            await mirror.way.finish()
            await self._within_bounds(mirror.publisher.close())
        finally:
            self._endpoints.pop(gid, None)
            self._leaving.pop(gid, None)
            self.notify()

    async def _within_bounds(self, closing: Awaitable[None]) -> None:
        """Limit the duration of closing, and catch its errors: it must not hold up or end the rest."""
        try:
            async with asyncio.timeout(_CLOSE_S):
                await closing
        except (TimeoutError, BusError):
            pass
        except Exception as error:
            self._warn(f"while a mirror was closed: {in_words(error)}")

    def _offer(self, far: Mirrored) -> QoSProfile:
        qos = far.qos
        if qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self._warn(
                f"'{far.topic}': manual liveliness does not cross a bridge; far publishers have automatic "
                "liveliness here"
            )
            qos = msgspec.structs.replace(qos, liveliness=Liveliness.AUTOMATIC)
        return qos

    def _fail(self, mirror: EndpointMirror, error: Exception) -> None:
        mirror.retry.fail(self._loop.time())
        far = mirror.far
        self._warn(
            f"the {far.far.kind} of {_full_name(far.node)} of '{far.node.bus}' on '{far.topic}' can't be "
            f"shown here: {in_words(error)}"
        )


def _full_name(far: MirroredNode) -> str:
    return f"{far.namespace.rstrip('/')}/{far.name}"


def _numbering(far: Mirrored) -> str:
    """The name of the numbering of its messages. In transit they have the numbers of a mirror, and each
    bridge makes new ones."""
    return far.far.node if far.node.via else ""

"""The declarations of a process at its broker: nodes, endpoints, their ids, and repeated declarations.

Knows endpoints only by the protocol `LinkEndpoint`.
"""

import asyncio
import os
from collections.abc import Callable, Iterator
from typing import Any, Protocol
from weakref import WeakKeyDictionary, ref

import msgspec

from bus.base.descriptor import Descriptor
from bus.errors import (
    AccessDenied,
    BusError,
    ConfigurationError,
    ConnectionClosed,
    QuotaExceeded,
    RemoteProtocolError,
    again,
)
from bus.link.connection import Connection
from bus.logger import get_logger
from bus.names import join_node_name
from bus.qos import QoSProfile
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.answers import RefusedForNow
from bus.wire.layout import BRIDGES
from bus.wire.runs import Run

_FINAL = (ConfigurationError, AccessDenied)
"""Permanent refusals. A refusal by a limit is temporary: there may be room later."""

AGAIN_S = 2.0
"""Time until the next try after a refusal by a limit."""

_ABOUT: dict[Any, str] = (
    dict.fromkeys((m.Matched, m.Unmatched, m.Incompatible, m.Rerouted), "endpoint")
    | dict.fromkeys((m.Dropped, m.LivelinessChanged, m.RingReplaced), "subscription")
    | dict.fromkeys((m.Credit, m.LivelinessLost, m.Attached, m.Silence), "publisher")
)
"""For each message, the field with the number of its endpoint."""

_log = get_logger("bus")


class Known(Protocol):
    """An object with an id at the broker; 0 while the broker does not know it."""

    id: int


class Declared(Known, Protocol):
    """A node or an endpoint, to which the broker assigns an id."""

    def declaration(self, request: int, node: int) -> m.Message: ...

    def declared(self, answer: m.Created) -> None: ...


class LinkNode:
    """A node's data for its link and the broker. `made_at`: file and line of the call that made the node."""

    def __init__(self, name: str, namespace: str, origin: m.Origin | None, made_at: tuple[str, int]) -> None:
        self.id = 0
        self.name = name
        self.namespace = namespace
        self.full_name = join_node_name(namespace, name)
        self.origin = origin
        self.made_at = made_at

    def declaration(self, request: int, node: int) -> m.Message:
        return m.CreateNode(request=request, name=self.name, namespace=self.namespace, origin=self.origin)

    def declared(self, answer: m.Created) -> None:
        self.id = answer.id


class Counted(Known, Protocol):
    """An endpoint as its link sees it, to send its samples and report its counters."""

    refusal: BusError | None

    def hand_over(self) -> None: ...

    def totals(self) -> m.Report: ...


class LinkEndpoint(Declared, Counted, Protocol):
    """A publisher or a subscription, as the link sees it."""

    kind: str
    topic_name: str
    qos: QoSProfile
    support: TypeSupport[Any]
    lease_s: float | None
    """Time within which the broker needs a sign of life of the endpoint, or None if it needs none."""

    def disconnected(self) -> None: ...

    @property
    def shared(self) -> tuple[Descriptor, ...]: ...

    def handle(self, message: Any, descriptors: tuple[Descriptor, ...] = ()) -> None: ...

    receive_lone: Callable[[Run], bool]

    def receive_run(self, run: Run) -> None: ...

    def wake(self) -> None: ...

    def end(self, reason: BusError) -> None: ...

    def abandon(self, reason: BusError) -> None: ...


class _Admission(msgspec.Struct):
    """The pending declaration of `what`.

    Its answer calls `act`, or `undo` if no call waits for it any more.
    """

    what: Declared
    act: Callable[[m.Created], None]
    undo: Callable[[m.Created], None]


def gone() -> None:
    """The default for look-ups in `Declarations.by_id`: like a weak reference to an endpoint that is gone."""


class Declarations:
    """The nodes and endpoints of a link.

    `by_id` has the endpoints that the broker knows at the moment. `on_lease` is called when an endpoint with
    a lease was added. References to nodes and endpoints are weak: the event loop keeps the link, and the
    collector must find a node that a program has dropped without closing it. A node and its endpoints refer
    to each other.
    """

    def __init__(self, on_lease: Callable[[], object]) -> None:
        self.by_id: dict[int, ref[LinkEndpoint]] = {}
        self._nodes: WeakKeyDictionary[LinkNode, WeakKeyDictionary[LinkEndpoint, None]] = WeakKeyDictionary()
        self._admissions: dict[int, _Admission] = {}
        self._waiting: dict[Declared, QuotaExceeded | RefusedForNow] = {}
        self._namesakes: set[str] = set()
        """Names of nodes with a logged warning that another node has the same name."""
        self._retry: asyncio.Task[None] | None = None
        self._retry_timer: asyncio.TimerHandle | None = None
        self._on_lease = on_lease
        self._held: dict[LinkNode, object] = {}
        """Owners of nodes that the collector must keep, even without other references."""

    def __iter__(self) -> Iterator[LinkEndpoint]:
        """All endpoints, in the order of their creation."""
        return iter([endpoint for endpoints in self._nodes.values() for endpoint in endpoints])

    @property
    def nodes(self) -> list[LinkNode]:
        """All nodes, in the order of their creation. May be called from other threads."""
        return [node for known in self._nodes.keyrefs() if (node := known()) is not None]

    def hold(self, node: LinkNode, owner: object) -> None:
        """Keep the `owner` of `node` alive until `remove_node`."""
        self._held[node] = owner

    async def add_node(self, connection: Connection, node: LinkNode) -> None:
        """Declare `node` to the broker. Raises the broker's refusal."""
        hello = connection.hello
        if node.origin is not None and BRIDGES not in hello.capabilities:
            raise ConfigurationError(
                f"{node.full_name} stands for a node of another bus, which busd {hello.release} (pid "
                f"{hello.pid}) does not know of: it is older than this program; run: bus daemon restart"
            )

        def admit(answer: m.Created) -> None:
            node.declared(answer)
            self._nodes.setdefault(node, WeakKeyDictionary())

        await self._declare(
            connection,
            node,
            0,
            admit,
            lambda answer: connection.send(m.DestroyNode(node=answer.id)),
        )

    async def add(self, connection: Connection, node: LinkNode, endpoint: LinkEndpoint) -> None:
        """Declare an endpoint of `node` to the broker.

        Raises the broker's refusal, and ConnectionClosed if the node is closed meanwhile.
        """

        def admit(answer: m.Created) -> None:
            if node not in self._nodes or endpoint.refusal is not None:
                undo(answer)
                return
            endpoint.declared(answer)
            self._nodes[node][endpoint] = None
            self.by_id[answer.id] = ref(endpoint)
            if endpoint.lease_s is not None:
                self._on_lease()

        def undo(answer: m.Created) -> None:
            if node in self._nodes:  # else the broker has removed the endpoint with its node
                connection.send(m.DestroyEndpoint(endpoint=answer.id))

        self._check(node)
        connection.share()
        connection.declare_type(endpoint.support)
        try:
            await self._declare(connection, endpoint, node.id, admit, undo, endpoint.shared)
        except (ConfigurationError, QuotaExceeded):
            connection.forget_type(endpoint.support)  # perhaps busd refused the type
            raise
        self._check(node)

    async def declare_again(self, connection: Connection) -> None:
        """Declare everything that a broker does not know.

        Refused endpoints end, and the log has the reason. After a refusal by a limit, or because a gid is in
        use, the declaration is repeated later: there may be room then.
        """
        nodes = [node for node in self.nodes if not node.id]
        await asyncio.gather(*(self._try_node_again(connection, node) for node in nodes))
        pairs = [
            (node, endpoint)
            for node, endpoints in tuple(self._nodes.items())
            if node.id
            for endpoint in endpoints
            if not endpoint.id
        ]
        await asyncio.gather(*(self._try_again(connection, node, endpoint) for node, endpoint in pairs))
        if self._waiting:
            self._ask_again_later(connection)

    def progress(self) -> tuple[int, int]:
        """The number of endpoints that the broker knows, and the number of all."""
        return sum(bool(endpoint.id) for endpoint in self), sum(map(len, self._nodes.values()))

    def admit(self, answer: m.Created) -> None:
        """Handle the answer to a declaration. Must be called before any later message is handled."""
        admission = self._admissions.pop(answer.request, None)
        if admission is not None:
            admission.act(answer)

    def concerned(self, news: Any) -> LinkEndpoint | None:
        """The endpoint of a message; None if the message is about no endpoint, or about a closed one."""
        field = _ABOUT.get(type(news))
        return None if field is None else self.by_id.get(getattr(news, field), gone)()

    def warn_of_namesake(self, news: m.Namesake) -> None:
        """Warn that another node has the name of one of ours: once, even if the broker changes."""
        node = next((node for node in self.nodes if node.id == news.node), None)
        if node is not None and node.full_name not in self._namesakes:
            self._namesakes.add(node.full_name)
            if news.pid == os.getpid():
                where = "in this process"
            elif news.pid:
                where = f"in pid {news.pid} ({news.program})"
            else:  # busd is in another pid namespace
                where = f"in a process of {news.program}"
            _log.warning(
                f"there is another node named {node.full_name}, {where}, and tools can't tell them apart; "
                "rename one, as by --ros-args -r __node:=NAME"
            )

    def remove(self, endpoint: LinkEndpoint) -> None:
        for endpoints in tuple(self._nodes.values()):
            endpoints.pop(endpoint, None)
        self.by_id.pop(endpoint.id, None)
        self._waiting.pop(endpoint, None)
        self._revoke(endpoint)

    def remove_node(self, node: LinkNode) -> None:
        self._held.pop(node, None)
        self._revoke(node)
        self._waiting.pop(node, None)
        self._nodes.pop(node, None)

    def disconnected(self) -> None:
        """Note that the broker is gone, and with it all ids."""
        if self._retry_timer is not None:  # its requests would have numbers of the next connection
            self._retry_timer.cancel()
            self._retry_timer = None
        self._admissions.clear()
        self._waiting.clear()
        self.by_id.clear()
        for node in self.nodes:
            node.id = 0
        for endpoint in self:
            endpoint.disconnected()

    def shortest_lease_s(self) -> float | None:
        """The shortest lease of all publishers."""
        return min((one.lease_s for one in self if one.lease_s is not None), default=None)

    def _check(self, node: LinkNode) -> None:
        if node not in self._nodes:
            raise ConnectionClosed(f"node {node.full_name} was closed, or a new busd refused it")
        if node in self._waiting:
            raise again(self._waiting[node])

    def _ask_again_later(self, connection: Connection) -> None:
        loop = asyncio.get_running_loop()

        def begin() -> None:
            if self._waiting:
                self._retry = loop.create_task(self._ask_again(connection), name="ask busd for room again")

        self._retry_timer = loop.call_later(AGAIN_S, begin)

    async def _ask_again(self, connection: Connection) -> None:
        try:
            await self.declare_again(connection)
            connection.flush()
        except ConnectionClosed:
            pass  # the next connection declares everything
        except (TimeoutError, RemoteProtocolError):
            self._ask_again_later(connection)

    def _wait(self, what: Declared, name: str, error: QuotaExceeded | RefusedForNow) -> None:
        if what not in self._waiting:
            _log.error(f"busd has no room for the {name}: {error}; asking again every {AGAIN_S:g} s")
        self._waiting[what] = error

    def _found_room(self, what: Declared, name: str) -> None:
        if self._waiting.pop(what, None) is not None:
            _log.info(f"busd has room for the {name} again")

    def _revoke(self, what: Declared) -> None:
        """Undo a declaration, because the call that waited for its answer is gone."""
        for admission in self._admissions.values():
            if admission.what is what:
                admission.act = admission.undo

    async def _try_node_again(self, connection: Connection, node: LinkNode) -> None:
        if node not in self._nodes:  # closed meanwhile
            return
        name = f"node {node.full_name}"
        try:
            await self.add_node(connection, node)
            self._found_room(node, name)
        except QuotaExceeded as error:
            if node in self._nodes:
                self._wait(node, name, error)
        except _FINAL as error:
            _log.error(f"the new busd refuses the {name}: {error}")
            self._waiting.pop(node, None)
            for endpoint in self._nodes.pop(node, {}):
                endpoint.end(error)

    async def _try_again(self, connection: Connection, node: LinkNode, endpoint: LinkEndpoint) -> None:
        if endpoint not in self._nodes.get(node, {}):  # closed meanwhile
            return
        name = f"{endpoint.kind} on '{endpoint.topic_name}'"
        try:
            await self.add(connection, node, endpoint)
            self._found_room(endpoint, name)
        except (QuotaExceeded, RefusedForNow) as error:
            if endpoint in self._nodes.get(node, {}):
                self._wait(endpoint, name, error)
        except _FINAL as error:
            _log.error(f"the new busd refuses the {name}: {error}")
            self.remove(endpoint)
            endpoint.end(error)
        except ConnectionClosed:
            if node in self._nodes:
                raise

    async def _declare(
        self,
        connection: Connection,
        what: Declared,
        node: int,
        admit: Callable[[m.Created], None],
        undo: Callable[[m.Created], None],
        descriptors: tuple[Descriptor, ...] = (),
    ) -> None:
        number = next(connection.numbers)
        self._admissions[number] = _Admission(what, admit, undo)
        try:
            await connection.request(number, what.declaration(number, node), m.Created, descriptors)
        except (asyncio.CancelledError, TimeoutError):
            self._revoke(what)
            raise
        except BaseException:
            self._admissions.pop(number, None)
            raise

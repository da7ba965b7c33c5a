"""What a process has declared at its broker: nodes and endpoints, the ids they got, and declaring them anew.

Knows endpoints only by what `LinkEndpoint` names.
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
"""Refusals for good. One by a limit is not: there may be room later."""

AGAIN_S = 2.0
"""How long until a broker is asked again that refused by a limit."""

_ABOUT: dict[Any, str] = (
    dict.fromkeys((m.Matched, m.Unmatched, m.Incompatible, m.Rerouted), "endpoint")
    | dict.fromkeys((m.Dropped, m.LivelinessChanged, m.RingReplaced), "subscription")
    | dict.fromkeys((m.Credit, m.LivelinessLost, m.Attached, m.Silence), "publisher")
)
"""The field that says which endpoint the news is for."""

_log = get_logger("bus")


class Known(Protocol):
    """What the broker may know by an id; 0 while it does not."""

    id: int


class Declared(Known, Protocol):
    """A node or an endpoint: the broker gives it an id."""

    def declaration(self, request: int, node: int) -> m.Message: ...

    def declared(self, answer: m.Created) -> None: ...


class LinkNode:
    """A node, as its link and the broker know it. `made_at`: file and line of the call that made it."""

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
    """Within what time the broker wants a sign of life of it, or None if it wants none."""

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
    """When the answer to the declaration of `what` comes: `act`, or `undo` if no call waits for it any
    more."""

    what: Declared
    act: Callable[[m.Created], None]
    undo: Callable[[m.Created], None]


def gone() -> None:
    """The default of a look-up in `Declarations.by_id`: like a weak reference to an endpoint that is gone."""


class Declarations:
    """`by_id` are the endpoints that the broker knows at the moment. `on_lease`: one with a lease was added.

    References to nodes and endpoints are weak: the event loop holds the link, and the collector must find a
    node that a program has dropped without closing it. A node and its endpoints hold each other.
    """

    def __init__(self, on_lease: Callable[[], object]) -> None:
        self.by_id: dict[int, ref[LinkEndpoint]] = {}
        self._nodes: WeakKeyDictionary[LinkNode, WeakKeyDictionary[LinkEndpoint, None]] = WeakKeyDictionary()
        self._admissions: dict[int, _Admission] = {}
        self._waiting: dict[Declared, QuotaExceeded | RefusedForNow] = {}
        self._namesakes: set[str] = set()
        """Names of nodes that the log has said others have too."""
        self._retry: asyncio.Task[None] | None = None
        self._on_lease = on_lease
        self._held: dict[LinkNode, object] = {}
        """Owners of nodes that the collector must not take, whoever refers to them."""

    def __iter__(self) -> Iterator[LinkEndpoint]:
        """Every endpoint, in the order in which they were made."""
        return iter([endpoint for endpoints in self._nodes.values() for endpoint in endpoints])

    @property
    def nodes(self) -> list[LinkNode]:
        """Every node, in the order in which they were made; for other threads too."""
        return [node for known in self._nodes.keyrefs() if (node := known()) is not None]

    def hold(self, node: LinkNode, owner: object) -> None:
        """Keep the collector from the `owner` of `node` until `remove_node`."""
        self._held[node] = owner

    async def add_node(self, connection: Connection, node: LinkNode) -> None:
        """Make `node` known to the broker. Raises what the broker refuses it with."""
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
        """Make an endpoint of `node` known to the broker.

        Raises what the broker refuses it with, ConnectionClosed where the node is closed meanwhile.
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
            if node in self._nodes:  # else the broker took the endpoint away with its node
                connection.send(m.DestroyEndpoint(endpoint=answer.id))

        self._check(node)
        connection.share()
        connection.declare_type(endpoint.support)
        try:
            await self._declare(connection, endpoint, node.id, admit, undo, endpoint.shared)
        except (ConfigurationError, QuotaExceeded):
            connection.forget_type(endpoint.support)  # it may be what was refused
            raise
        self._check(node)

    async def declare_again(self, connection: Connection) -> None:
        """Tell a broker everything that it does not know.

        What it refuses is ended, and the log says why. What it refuses by a limit, or because a gid is taken,
        is declared again later: there may be room then.
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
        """How many endpoints the broker knows, and of how many."""
        return sum(bool(endpoint.id) for endpoint in self), sum(map(len, self._nodes.values()))

    def admit(self, answer: m.Created) -> None:
        """The broker has made something. To be called before any later message is handled."""
        admission = self._admissions.pop(answer.request, None)
        if admission is not None:
            admission.act(answer)

    def concerned(self, news: Any) -> LinkEndpoint | None:
        """The endpoint that a message is about; None if it is about no endpoint, or a closed one."""
        field = _ABOUT.get(type(news))
        return None if field is None else self.by_id.get(getattr(news, field), gone)()

    def warn_of_namesake(self, news: m.Namesake) -> None:
        """Another node has the name of one of ours. The log says so once, also where brokers come and go."""
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
        """The broker is gone, and with it all ids."""
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

        loop.call_later(AGAIN_S, begin)

    async def _ask_again(self, connection: Connection) -> None:
        try:
            await self.declare_again(connection)
            connection.flush()
        except ConnectionClosed:
            pass  # then it is the next connection's turn
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
        """The call that waited for the answer to its declaration is gone: undo what the broker makes."""
        for admission in self._admissions.values():
            if admission.what is what:
                admission.act = admission.undo

    async def _try_node_again(self, connection: Connection, node: LinkNode) -> None:
        if node not in self._nodes:  # closed a moment ago
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
        if endpoint not in self._nodes.get(node, {}):  # closed a moment ago
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

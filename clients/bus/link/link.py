"""The link of a process to its broker: samples and control messages both ways, and recovery.

Nodes of one event loop that use the same socket share a link. When the broker comes back, the link
connects and declares everything again.
"""

import asyncio
import os
import weakref
from collections.abc import Callable, Coroutine
from functools import partial
from threading import get_ident
from time import monotonic_ns, time_ns
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from bus.base.descriptor import Descriptor
from bus.errors import BusError, ConnectionClosed, ForkError, again
from bus.link.connecting import Connecting
from bus.link.connection import Connection
from bus.link.declarations import Counted, Declarations, Known, LinkEndpoint, LinkNode
from bus.link.incoming import Incoming
from bus.link.reports import Reports
from bus.link.shm_context import ShmContext
from bus.process import guarded
from bus.process.waiters import Waiters
from bus.wire import messages as m
from bus.wire.runs import Buffer, RunQueue

if TYPE_CHECKING:  # most programs never watch the graph
    from bus.link.observing import GraphObservers

A = TypeVar("A", bound=m.Message)

_SHORTEST_BEAT_S = 0.01


class LoopCalls:
    """The running event loop, with the methods that delivery needs (`bus.delivery.port.Port`)."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.guarded_loop = guarded(self.loop)
        self.is_shared = self.guarded_loop is not None
        self.owns_thread = _is_thread(get_ident()) if self.guarded_loop is None else self.guarded_loop.is_mine
        self.now_ns = monotonic_ns
        self.soon = self.loop.call_soon
        self.soon_threadsafe = self.loop.call_soon_threadsafe
        self.later = self.loop.call_later

    async def turn(self) -> None:
        """Give the loop a turn."""
        await asyncio.sleep(0)

    def waiters(self) -> Waiters:
        return Waiters(self.loop)

    def start(self, work: Coroutine[Any, Any, None], name: str) -> Callable[[], None]:
        """Run `work` as a task. Returns a function that cancels it, but not if the task itself calls that."""
        task = self.loop.create_task(work, name=name)
        # asyncio reports pending tasks that the collector finds. Here only the node is reported.
        task._log_destroy_pending = False  # type: ignore[attr-defined]

        def cancel() -> None:
            if task is not asyncio.current_task():
                task.cancel()

        return cancel


class Link(LoopCalls):
    """A link to a broker; `Link.acquire` returns one, `release` gives it back."""

    _links: ClassVar["weakref.WeakValueDictionary[int, Link]"] = weakref.WeakValueDictionary()
    """All links, by the ids of the objects."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self.path = path
        self.wall_offset_ns = _wall_offset_ns()
        self.last_sent_ns = 0  # time of the last frame sent at once, without gathering
        self.failure: BusError | None = None
        self._users = 0
        self.connection: Connection | None = None
        """None while the broker is away."""
        self._declarations = Declarations(self._set_heartbeat)
        self.gathered: set[Counted] = set()
        """Publishers that have begun a run in this turn of the loop."""
        self._reports = Reports(self.loop, self._report)
        self._incoming = Incoming(self, self._declarations, self._reports)
        self._connecting = Connecting(self, self._declarations, self._incoming.received)
        self.broker = self._connecting.hello.pid, self._connecting.hello.began_ns
        """The present broker, or the last one. A broker that restarts keeps its process id."""
        self.shm_context = ShmContext.make(self._incoming.deliver)
        self._drains = Waiters(self.loop)
        self.observers: GraphObservers | None = None
        """None before the first watch of the graph."""
        Link._links[id(self)] = self

    # --- making and ending

    @classmethod
    def all(cls) -> list["Link"]:
        """All links of this process; safe while other threads make links."""
        return [link for known in cls._links.valuerefs() if (link := known()) is not None]

    @classmethod
    async def acquire(cls, path: str) -> "Link":
        """The link of this event loop to the socket `path`, connected.

        Raises BrokerUnavailable if no broker answers and none could be started.
        """
        loop = asyncio.get_running_loop()
        for link in cls.all():
            if link.path == path and link.loop is loop and link.failure is None:
                break
        else:
            link = cls(path)
            link._connecting.begin()
        link._users += 1
        try:
            if (opening := link._connecting.opening) is not None:
                await asyncio.shield(opening)
        except BaseException:
            link.release()
            raise
        return link

    def abandon(self, reason: BusError) -> None:
        """Close the connection without touching a task, a future or a timer.

        For the child of a fork, because the loop belongs to the parent, and for a closed loop.
        """
        self.failure = reason
        if self.connection is not None:
            self.connection.abandon()
        if self.shm_context is not None:
            self.shm_context.abandon()
        for endpoint in self._declarations:
            endpoint.abandon(reason)

    def namesake(self, node: LinkNode) -> LinkNode | None:
        """A node of the same name that this process has open on another link, after a report of busd.

        busd itself can't distinguish such a link from an earlier connection of this process.
        """
        for link in Link.all():
            if link is not self and link.path == self.path and link.failure is None:
                for other in link._declarations.nodes:
                    if other.full_name == node.full_name:
                        return other
        return None

    @property
    def is_connected(self) -> bool:
        """Whether the broker is there and knows everything that was declared."""
        is_open = self.connection is not None and self._connecting.opening is None
        return is_open and self.failure is None

    def connection_now(self) -> object:
        """A key for the present connection: the broker's ids are valid only on it."""
        return self.connection

    def release(self) -> None:
        """Give the link back; the last user closes the connection."""
        self._users -= 1
        if self._users or self.failure is not None:
            return
        if self.loop.is_closed():  # it has no work left, and none may be scheduled
            self.abandon(ConnectionClosed("the event loop of this connection to busd is closed"))
            return
        self.failure = ConnectionClosed("the connection to busd is closed")
        if self._connecting.opening is not None:
            self._connecting.opening.cancel()
        self._reports.end()
        if self.connection is not None:
            self.connection.close()
        if self.shm_context is not None:
            self.shm_context.close()
        self._drains.release()
        if self.observers is not None:
            self.observers.stop()

    # --- called by Connecting

    def connected(self, connection: Connection) -> None:
        """Use a new connection: to another broker, or to the same one again."""
        self.broker = connection.hello.pid, connection.hello.began_ns
        self._set_heartbeat()

    def declared_again(self) -> None:
        """The present broker knows everything that the last one knew."""
        if self.observers:
            self.observers.ask()
        self.flush()
        self._drains.release()

    # --- declarations

    async def declare_node(self, node: LinkNode) -> None:
        """Declare `node` to the broker, now and after each reconnection."""
        await self._connecting.when_connected(partial(self._declarations.add_node, node=node))

    def hold(self, node: LinkNode, owner: object) -> None:
        """Keep the `owner` of `node` alive until `forget_node`, while the event loop is open."""
        self._declarations.hold(node, owner)

    def declare(self, node: LinkNode, endpoint: LinkEndpoint) -> Coroutine[Any, Any, None]:
        """Declare an endpoint of `node` to the broker, now and after each reconnection.

        Raises the broker's refusal (`Connection.request`). Cancellation: not declared.
        """
        return self._connecting.when_connected(partial(self._declarations.add, node=node, endpoint=endpoint))

    def forget(self, endpoint: LinkEndpoint) -> None:
        """Remove an endpoint from the graph."""
        self.gathered.discard(endpoint)
        self._reports.send_last(endpoint)
        self._declarations.remove(endpoint)
        self.send_about(endpoint, m.DestroyEndpoint(endpoint=endpoint.id))
        endpoint.id = 0  # its last messages must not be acknowledged any more
        if endpoint.lease_s is not None:
            self._set_heartbeat()

    def forget_node(self, node: LinkNode) -> None:
        """Remove a node from the graph; its endpoints must have been closed."""
        self._declarations.remove_node(node)
        self.send_about(node, m.DestroyNode(node=node.id))
        node.id = 0

    def send_about(
        self, what: Known, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = ()
    ) -> None:
        """Send a message (or frame) about `what`; does nothing if the broker does not know it at the
        moment."""
        if what.id and message and self.connection is not None:
            self.connection.send(message, descriptors)

    def is_quiet(self) -> bool:
        """Whether everything that the broker has sent was read; True also without a broker."""
        return not self._incoming.is_receiving and (self.connection is None or self.connection.is_quiet)

    async def request(self, make: Callable[[int], m.Message], kind: type[A]) -> A:
        """Send a request to the broker; see `Connection.request`. Waits for a broker that is away."""
        return await self._connecting.when_connected(
            lambda connection: connection.request(number := next(connection.numbers), make(number), kind)
        )

    async def description(self, type_name: str, type_hash: str) -> bytes:
        """The description of a type on the bus, from its endpoints (`bus.types.schema`, in MessagePack).

        Raises ConfigurationError if no endpoint has it.
        """
        answer = await self.request(
            lambda number: m.GetType(request=number, type_name=type_name, type_hash=type_hash),
            m.TypeDescription,
        )
        return answer.schema

    def watch(self) -> "GraphObservers":
        """The callbacks for changes of the graph."""
        if self.observers is None:
            from bus.link.observing import GraphObservers

            self.observers = GraphObservers(self)
        return self.observers

    # --- samples out

    def gather(self, publisher: Counted) -> None:
        """Send the new run of `publisher` together with others when the turn of the loop ends."""
        if not self.gathered:
            self.soon(self.hand_over)
        self.gathered.add(publisher)

    def send_now(self, frame: Buffer) -> bool:
        """Send a data frame at once if nothing is queued; returns whether it was sent."""
        return self.connection is not None and self.connection.send_now(frame)

    def make_ready(self, queue: RunQueue) -> None:
        """Schedule a `queue` that has runs for the broker."""
        if self.connection is not None:
            self.connection.outbox.make_ready(queue)

    def flush(self) -> None:
        """Send queued data, as far as the socket accepts it."""
        if self.connection is not None:
            self.connection.flush()

    async def wait_for_drain(self, queue: RunQueue) -> None:
        """Wait until the socket has accepted everything in `queue`.

        Raises ConnectionClosed if the link ends.
        """
        is_chosen = False
        while not is_chosen:
            if self.failure is not None:
                raise again(self.failure)
            is_chosen = not queue.runs  # written when the socket has accepted all chosen data
            if not is_chosen or self.is_writing:
                await self._drains.wait()

    def report(self, endpoint: Counted) -> None:
        self._reports.add(endpoint)  # sent to the broker soon

    def report_now(self) -> None:
        """Send all due reports now, for a loop that may never run again."""
        self._reports.flush()

    @property
    def is_writing(self) -> bool:
        """Whether the socket has not accepted all data chosen for it."""
        return self.connection is not None and self.connection.is_writing

    def hand_over(self) -> None:
        """Send gathered and queued data, as far as the socket accepts it."""
        gathered, self.gathered = self.gathered, set()
        for publisher in gathered:
            publisher.hand_over()
        if self.connection is not None:
            self.connection.flush()

    def wrote(self) -> None:
        """Note that the socket accepts bytes again: queued data was sent, or can be sent now."""
        if self._drains:
            self.loop.call_soon(self._drains.release)  # they check again after the next choice

    def _report(self, endpoint: Counted, frames: bytes) -> None:
        now_ns = monotonic_ns()
        self.wall_offset_ns = _wall_offset_ns(self.wall_offset_ns)  # the wall clock may have been set
        if (connection := self.connection) is not None:
            if now_ns > connection.late_ns:
                connection.note_standstill(now_ns)
            connection.turn_ns = now_ns
        self.send_about(endpoint, frames)

    def _set_heartbeat(self) -> None:
        connection = self.connection
        if connection is not None and (most_s := connection.hello.lease_s):
            shortest_s = self._declarations.shortest_lease_s() or most_s
            connection.beat(max(min(shortest_s, most_s) / 3, _SHORTEST_BEAT_S))


def _wall_offset_ns(known_ns: int | None = None) -> int:
    """How far the wall clock is ahead of the monotonic one; `known_ns`, if that may still be right.

    A process switch between the readings must not look like a change of the wall clock: the times of
    received messages would decrease later.
    """
    before_ns, wall_ns, after_ns = monotonic_ns(), time_ns(), monotonic_ns()
    if known_ns is not None and wall_ns - after_ns <= known_ns <= wall_ns - before_ns:
        return known_ns
    return wall_ns - (before_ns + after_ns) // 2


def _is_thread(number: int) -> Callable[[], bool]:
    return lambda: get_ident() == number


def _forked() -> None:
    reason = ForkError("this node was made before a fork; make a node of its own in the child process")
    for link in Link.all():
        link.abandon(reason)


os.register_at_fork(after_in_child=_forked)

"""The link of a process to its broker: samples and news both ways, and recovery.

Nodes of one event loop that use the same socket share a link. When the broker comes back, the link
connects and declares everything again.
"""

import asyncio
import os
import weakref
from collections.abc import Awaitable, Callable, Collection, Coroutine, Iterable
from functools import partial
from threading import get_ident
from time import monotonic_ns, time_ns
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from bus.base.descriptor import Descriptor
from bus.errors import BrokerUnavailable, BusError, ConnectionClosed, ForkError, RemoteProtocolError, again
from bus.link.connection import Connection
from bus.link.declarations import Counted, Declarations, Known, LinkEndpoint, LinkNode, gone, lease_s
from bus.link.reach import NotNow, Patience
from bus.link.reports import Reports
from bus.link.shm_context import ShmContext
from bus.logger import get_logger
from bus.process.shared_loop import GuardedLoop
from bus.process.waiters import Waiters
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.runs import Buffer, Run, RunQueue
from bus.wire.session import Carried

if TYPE_CHECKING:  # most programs never look
    from bus.link.graph_mirror import GraphMirror

A = TypeVar("A", bound=m.Message)
T = TypeVar("T")

_SHORTEST_BEAT_S = 0.01
_USERS_TURN_NS = 5_000_000_000
_RETRY_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_TELL_S = 3.0

_log = get_logger("bus")


class Link:
    """Got by `Link.acquire`, given back with `release`."""

    _links: ClassVar["weakref.WeakValueDictionary[int, Link]"] = weakref.WeakValueDictionary()
    """By their ids."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.loop = asyncio.get_running_loop()
        self.guarded_loop = self.loop if isinstance(self.loop, GuardedLoop) else None
        self.is_shared = self.guarded_loop is not None
        self.owns_thread = _is_thread(get_ident()) if self.guarded_loop is None else self.guarded_loop.is_mine
        self.now_ns = monotonic_ns
        self.soon = self.loop.call_soon
        self.soon_threadsafe = self.loop.call_soon_threadsafe
        self.later = self.loop.call_later
        self.wall_offset_ns = time_ns() - monotonic_ns()
        self.last_sent_ns = 0  # when a publisher last sent past the gathering
        self.failure: BusError | None = None
        self._users = 0
        # The present broker's, or the last one's:
        self._hello = m.Hello(version=PROTOCOL_VERSION, background=True)
        self.broker = self._hello.pid, self._hello.began_ns
        """The present broker, or the last one. A broker that restarts keeps its process id."""
        self._connection: Connection | None = None
        self._opening: asyncio.Task[None] | None = None
        self._declarations = Declarations()
        self._held: dict[LinkNode, object] = {}
        self.shm_context = ShmContext.make(self._deliver)
        self._is_receiving = False
        self._gathered: set[Counted] = set()
        self._reports = Reports(self.loop, self._report)
        self._drains = Waiters(self.loop)
        self._observers: list[Callable[[], None]] = []
        self.graph_mirror: GraphMirror
        """While the graph is observed here."""
        self._mirroring: asyncio.Task[None] | None = None
        Link._links[id(self)] = self

    # --- making and ending

    @classmethod
    def all(cls) -> list["Link"]:
        """Every link of this process, while other threads may make theirs."""
        return [link for known in cls._links.valuerefs() if (link := known()) is not None]

    @classmethod
    async def acquire(cls, path: str) -> "Link":
        """The link of this event loop to the socket `path`, connected.

        Raises BrokerUnavailable where no broker answers and none could be started.
        """
        loop = asyncio.get_running_loop()
        for link in cls.all():
            if link.path == path and link.loop is loop and link.failure is None:
                break
        else:
            link = cls(path)
            link._opening = loop.create_task(link._open(), name="connect to busd")
        link._users += 1
        try:
            if link._opening is not None:
                await asyncio.shield(link._opening)
        except BaseException:
            link.release()
            raise
        return link

    def abandon(self, reason: BusError) -> None:
        """In the child of a fork, whose loop is the parent's, or with a closed loop: close the connection
        without touching a task, a future or a timer."""
        self.failure = reason
        if self._connection is not None:
            self._connection.abandon()
        if self.shm_context is not None:
            self.shm_context.abandon()
        for endpoint in self._declarations:
            endpoint.abandon(reason)

    def namesake(self, node: LinkNode) -> LinkNode | None:
        """A node of the same name that this process has open by another link; busd reports one by this link.

        busd itself can't tell such a link from an earlier connection of this process.
        """
        for link in Link.all():
            if link is not self and link.path == self.path and link.failure is None:
                for other in link._declarations.nodes:
                    if other.full_name == node.full_name:
                        return other
        return None

    def connection_now(self) -> object:
        """A key for the present connection, by which the broker's ids are valid."""
        return self._connection

    def release(self) -> None:
        """One user less; the last one closes the connection."""
        self._users -= 1
        if self._users or self.failure is not None:
            return
        if self.loop.is_closed():  # then it has no work left, and none may be scheduled
            self.abandon(ConnectionClosed("the event loop of this connection to busd is closed"))
            return
        self.failure = ConnectionClosed("the connection to busd is closed")
        if self._opening is not None:
            self._opening.cancel()
        self._reports.end()
        if self._connection is not None:
            self._connection.close()
        if self.shm_context is not None:
            self.shm_context.close()
        self._drains.release()
        self._stop_mirroring()

    # --- what is declared

    async def declare_node(self, node: LinkNode) -> None:
        """Make `node` known to the broker, now and after each reconnection."""
        await self._when_connected(partial(self._declarations.add_node, node=node))

    def hold(self, node: LinkNode, owner: object) -> None:
        """Keep the collector from the `owner` of `node` until `forget_node`, as long as the event loop is not
        closed."""
        self._held[node] = owner

    async def declare(self, node: LinkNode, endpoint: LinkEndpoint) -> None:
        """Make an endpoint of `node` known to the broker, now and after each reconnection.

        Raises what the broker refuses it with (`Connection.request`). Cancellation: not declared.
        """
        await self._when_connected(partial(self._declarations.add, node=node, endpoint=endpoint))
        if lease_s(endpoint) is not None:
            self._set_heartbeat()

    def forget(self, endpoint: LinkEndpoint) -> None:
        """Take an endpoint out of the graph."""
        self._gathered.discard(endpoint)
        self._reports.send_last(endpoint)
        self._declarations.remove(endpoint)
        self.send_about(endpoint, m.DestroyEndpoint(endpoint=endpoint.id))
        endpoint.id = 0  # its last messages must not be acknowledged any more
        if lease_s(endpoint) is not None:
            self._set_heartbeat()

    def forget_node(self, node: LinkNode) -> None:
        """Take a node out of the graph; its endpoints must have been closed."""
        self._held.pop(node, None)
        self._declarations.remove_node(node)
        self.send_about(node, m.DestroyNode(node=node.id))
        node.id = 0

    def send_about(
        self, what: Known, message: m.Message | bytes, descriptors: tuple[Descriptor, ...] = ()
    ) -> None:
        """Send a message (or frame) about `what`; nothing where the broker does not know it at the moment."""
        if what.id and message and self._connection is not None:
            self._connection.send(message, descriptors)

    def is_quiet(self) -> bool:
        """Whether all that the broker has sent was read; True also where there is none."""
        return not self._is_receiving and (self._connection is None or self._connection.is_quiet)

    async def request(self, make: Callable[[int], m.Message], kind: type[A]) -> A:
        """Ask the broker something; see `Connection.request`. Waits for a broker that is away."""
        return await self._when_connected(
            lambda connection: connection.request(number := next(connection.numbers), make(number), kind)
        )

    async def description(self, type_name: str, type_hash: str) -> bytes:
        """The description of a type on the bus, as its endpoints gave it (`bus.types.schema`, in
        MessagePack).

        Raises ConfigurationError where no endpoint has it.
        """
        answer = await self.request(
            lambda number: m.GetType(request=number, type_name=type_name, type_hash=type_hash),
            m.TypeDescription,
        )
        return answer.schema

    def observe(self, tell: Callable[[], None]) -> None:
        """Keep `graph_mirror` up to date, and call `tell` when that has changed, until `stop_observing`."""
        self._observers.append(tell)
        if len(self._observers) == 1 or self.graph_mirror.failure is not None:  # who asks again is answered
            self._mirror()

    def stop_observing(self, tell: Callable[[], None]) -> None:
        self._observers.remove(tell)
        if not self._observers:
            self._stop_mirroring()
            if self._connection is not None:
                self._connection.send(m.Observe(request=0, on=False))

    def _mirror(self) -> None:
        from bus.link.graph_mirror import GraphMirror

        self._stop_mirroring()
        self.graph_mirror = GraphMirror()
        self._mirroring = self.loop.create_task(
            self._ask_for_graph(self.graph_mirror), name="watch the graph"
        )

    def _stop_mirroring(self) -> None:
        if self._mirroring is not None:
            self._mirroring.cancel()
            self._mirroring = None

    async def _ask_for_graph(self, mirror: "GraphMirror") -> None:
        """Ask until busd answers; the log says if it is silent."""
        while mirror.graph is None and mirror.failure is None:
            try:
                mirror.begin(await self.request(lambda number: m.Observe(request=number), m.GraphSnapshot))
            except TimeoutError:
                continue
            except BusError as error:
                mirror.failure = error
        self._tell_observers()

    def _tell_observers(self) -> None:
        for tell in tuple(self._observers):
            tell()

    # --- samples out

    def gather(self, publisher: Counted) -> None:
        """`publisher` has begun a run, which leaves with the others when the turn of the loop ends."""
        if not self._gathered:
            self.soon(self.hand_over)
        self._gathered.add(publisher)

    def send_now(self, frame: Buffer) -> bool:
        """Send a data frame at once, where nothing waits to be sent; returns whether it was."""
        return self._connection is not None and self._connection.send_now(frame)

    def make_ready(self, queue: RunQueue) -> None:
        """`queue` has runs for the broker."""
        if self._connection is not None:
            self._connection.outbox.make_ready(queue)

    def flush(self) -> None:
        """Send what waits, as far as the socket takes it."""
        if self._connection is not None:
            self._connection.flush()

    async def wait_for_drain(self, queue: RunQueue) -> None:
        """Wait until the socket has all that was in `queue`. Raises ConnectionClosed where the link ends."""
        is_chosen = False
        while not is_chosen:
            if self.failure is not None:
                raise again(self.failure)
            is_chosen = not queue.runs  # and written when the socket has taken all that was
            if not is_chosen or self.is_writing:
                await self._drains.wait()

    def report(self, endpoint: Counted) -> None:
        self._reports.add(endpoint)  # soon the broker gets them

    def report_now(self) -> None:
        """Report all that is due, for a loop that perhaps never runs again."""
        self._reports.flush()

    @property
    def is_writing(self) -> bool:
        """Whether the socket has yet to take some of what was chosen for it."""
        return self._connection is not None and self._connection.is_writing

    def hand_over(self) -> None:
        """Send what was gathered, and what waits, as far as the socket takes it."""
        gathered, self._gathered = self._gathered, set()
        for publisher in gathered:
            publisher.hand_over()
        if self._connection is not None:
            self._connection.flush()

    def wrote(self) -> None:
        """The socket takes bytes again: what waited was sent, or can be now."""
        if self._drains:
            self.loop.call_soon(self._drains.release)  # they look again after the next choice

    def _report(self, endpoint: Counted, frames: bytes) -> None:
        now_ns = monotonic_ns()
        self.wall_offset_ns = time_ns() - now_ns  # the wall clock may have been set
        if (connection := self._connection) is not None:
            if now_ns > connection.late_ns:
                connection.note_standstill(now_ns)
            connection.turn_ns = now_ns
        self.send_about(endpoint, frames)

    # --- the event loop, for delivery

    async def turn(self) -> None:
        """Let the loop have a turn."""
        await asyncio.sleep(0)

    def waiters(self) -> Waiters:
        return Waiters(self.loop)

    def start(self, work: Coroutine[Any, Any, None], name: str) -> Callable[[], None]:
        """Run `work` as a task; returns what cancels it, unless the task itself calls that."""
        task = self.loop.create_task(work, name=name)
        # asyncio reports a pending task that the collector finds; here the node is reported, and only that.
        task._log_destroy_pending = False  # type: ignore[attr-defined]

        def cancel() -> None:
            if task is not asyncio.current_task():
                task.cancel()

        return cancel

    # --- what comes in

    def _received(self, items: Iterable[Any]) -> None:
        received_ns = monotonic_ns()
        if (connection := self._connection) is not None:
            if received_ns > connection.late_ns:
                connection.note_standstill(received_ns)
            connection.heard_ns = received_ns
        if items.__class__ is tuple and self._deliver_lone(items, received_ns):
            return
        endpoints, touched = self._declarations.by_id, set[LinkEndpoint]()
        ending: BaseException | None = None
        self._is_receiving = True
        try:
            for item in items:
                try:
                    if item.__class__ is Run:
                        subscription = endpoints.get(item.endpoint, gone)()
                        if subscription is not None:  # else it was closed a moment ago
                            item.received_ns = received_ns
                            touched.add(subscription)
                            subscription.receive_run(item)
                    else:
                        self._handle(item)
                except RemoteProtocolError:
                    raise
                except Exception as error:
                    self._tell_loop(error)  # the rest of the read is for others
                except BaseException as error:
                    if self.failure is not None:
                        raise
                    # It ends this turn, perhaps the loop: the rest is taken up now and delivered later.
                    ending = error
        finally:
            self._is_receiving = False
            if ending is None and touched:
                self._deliver(touched)
        if ending is not None:
            self.loop.call_soon(self._deliver, touched)
            raise ending

    def _deliver_lone(self, items: Any, received_ns: int) -> bool:
        """A read has brought one run and nothing else: call back for it, with nothing in between."""
        run = items[0]
        endpoint = self._declarations.by_id.get(run.endpoint, gone)()
        if endpoint is None:
            return False
        run.received_ns = received_ns
        try:
            is_done = endpoint.receive_lone(run)
        except Exception as error:
            self._tell_loop(error)
            is_done = True
        if is_done:
            self._reports.add(endpoint)
        return is_done

    def _deliver(self, endpoints: Collection[LinkEndpoint]) -> None:
        """Something has come for these. Callbacks go first: for them the delay counts."""
        left = iter(endpoints)
        for endpoint in left:
            try:
                endpoint.wake()
            except Exception as error:
                self._tell_loop(error)
            except BaseException:  # of this turn, perhaps of the loop: the others' is the next
                self.loop.call_soon(self._deliver, list(left))
                raise
        if endpoints:
            self._reports.add_all(endpoints)

    def _tell_loop(self, error: Exception) -> None:
        self.loop.call_exception_handler({"message": "handling what came from busd", "exception": error})

    def _handle(self, message: Any) -> None:
        descriptors: tuple[Descriptor, ...] = ()
        if isinstance(message, Carried):
            message, descriptors = message
        if isinstance(message, m.Created):
            # At once, not when the request's task runs: its news and samples may be in the same read.
            self._declarations.admit(message)
        connection = self._connection
        if connection is None or connection.resolve(message):
            return
        if isinstance(message, m.GraphChanged):
            if self._observers:  # else it was on its way
                self.graph_mirror.change(message)
                self._tell_observers()
        elif isinstance(message, m.Namesake):
            self._declarations.warn_of_namesake(message)
        elif (endpoint := self._declarations.concerned(message)) is not None:
            endpoint.handle(message, descriptors)

    # --- connecting

    async def _open(self) -> None:
        try:
            await self._connect_first()
        except BaseException as error:
            self.failure = error if isinstance(error, BusError) else BrokerUnavailable(str(error))
            raise
        finally:
            self._opening = None

    async def _connect_first(self) -> None:
        patience = Patience()
        while True:
            try:
                await self._connect(patience)
                return
            except NotNow as error:
                await asyncio.sleep(patience.pause_s(str(error)))

    async def _connect(self, patience: Patience, *, may_start: bool = True) -> Connection:
        connection = Connection(
            self.shm_context, on_received=self._received, on_lost=self._lost, on_wrote=self.wrote
        )
        self._connection = connection
        try:
            await connection.open(self.path, patience, may_start=may_start)
        except BaseException:
            self._connection = None
            raise
        self._hello = connection.hello
        self.broker = self._hello.pid, self._hello.began_ns
        self._set_heartbeat()
        return connection

    def _lost(self, reason: BusError) -> None:
        self._connection = None
        self._declarations.disconnected()
        if self.failure is None and self._opening is None:
            _log.warning(f"lost busd ({reason}); reconnecting")
            self._opening = self.loop.create_task(self._reconnect(), name="reconnect to busd")

    async def _reconnect(self) -> None:
        pauses = iter(_RETRY_S)
        pause_s = 0.0
        known_reason = ""
        lost_ns = monotonic_ns()
        try:
            while True:
                pause_s = next(pauses, pause_s)
                await asyncio.sleep(pause_s)
                # A user who started the daemon by hand starts it again, with its options: leave time for
                # that.
                may_start = self._hello.background or monotonic_ns() - lost_ns > _USERS_TURN_NS
                try:
                    await self._declare_again(await self._connect(Patience(), may_start=may_start))
                except (OSError, BusError) as error:
                    log = _log.debug if str(error) == known_reason else _log.warning
                    known_reason = str(error)
                    log(f"busd is not back yet: {error}")
                    if self._connection is not None:
                        self._connection.close()
                        self._connection = None
                        self._declarations.disconnected()
                    continue
                if self._connection is not None:  # else lost again, a moment ago
                    _log.info(f"busd is back (pid {self._hello.pid})")
                    return
        finally:
            self._opening = None

    async def _when_connected(self, action: Callable[[Connection], Awaitable[T]]) -> T:
        while True:
            while self._opening is not None and self.failure is None:
                await asyncio.wait([self._opening])  # whatever becomes of it
            if self.failure is not None:
                raise again(self.failure)
            if (connection := self._connection) is None:
                raise ConnectionClosed("the connection to busd is closed")
            self.hand_over()  # what was published before must not seem to come after
            try:
                return await action(connection)
            except ConnectionClosed:
                if self._opening is None:
                    raise

    async def _declare_again(self, connection: Connection) -> None:
        telling = self.loop.create_task(self._tell_progress(), name="tell how far the way back to busd is")
        try:
            await self._declarations.declare_again(connection)
        finally:
            telling.cancel()
        if self._observers:
            self._mirror()
        self.flush()
        self._drains.release()

    async def _tell_progress(self) -> None:
        """Say, after a while, that it takes long. To be cancelled when all is declared."""
        while True:
            await asyncio.sleep(_TELL_S)
            done, total = self._declarations.progress()
            _log.info(f"busd is back: {done} of {total} endpoints declared again")

    def _set_heartbeat(self) -> None:
        connection = self._connection
        if connection is not None and (most_s := connection.hello.lease_s):
            shortest_s = self._declarations.shortest_lease_s() or most_s
            connection.beat(max(min(shortest_s, most_s) / 3, _SHORTEST_BEAT_S))


def _is_thread(number: int) -> Callable[[], bool]:
    return lambda: get_ident() == number


def _forked() -> None:
    reason = ForkError("this node was made before a fork; make a node of its own in the child process")
    for link in Link.all():
        link.abandon(reason)


os.register_at_fork(after_in_child=_forked)

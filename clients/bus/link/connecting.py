"""Connects a link to its broker. If the broker is lost, it reconnects and declares everything again."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from time import monotonic_ns
from typing import Any, Protocol, TypeVar

from bus.errors import BrokerUnavailable, BusError, ConnectionClosed, again
from bus.link.connection import Connection
from bus.link.declarations import Counted, Declarations
from bus.link.reach import NotNow, Patience
from bus.link.shm_context import ShmContext
from bus.logger import get_logger
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION

__all__ = ["Connecting"]

T = TypeVar("T")

_USERS_TURN_NS = 5_000_000_000
_RETRY_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_LASTED_NS = 1_000_000_000
"""After a connection that lasted so long, the pauses begin anew: a broker that cuts off its client at once is
not called as often as possible."""
_REPORT_S = 3.0

_log = get_logger("bus")


class _Link(Protocol):
    """The link to connect."""

    path: str
    loop: asyncio.AbstractEventLoop
    connection: Connection | None
    failure: BusError | None
    gathered: set[Counted]
    shm_context: ShmContext | None

    def connected(self, connection: Connection) -> None: ...

    def declared_again(self) -> None: ...

    def hand_over(self) -> None: ...

    def wrote(self) -> None: ...


class Connecting:
    """Sets `link.connection`: None while the broker is away."""

    def __init__(
        self, link: _Link, declarations: Declarations, on_received: Callable[[Iterable[Any]], None]
    ) -> None:
        self.hello = m.Hello(version=PROTOCOL_VERSION, background=True)
        """The Hello of the present broker, or of the last one."""
        self.opening: asyncio.Task[None] | None = None
        """The task that connects, until everything is declared on the connection."""
        self._link = link
        self._declarations = declarations
        self._on_received = on_received
        self._tries = 0
        """Attempts to reconnect since the last connection that lasted."""
        self._back_ns = 0

    def begin(self) -> None:
        """Connect for the first time. `opening` raises BrokerUnavailable if that fails."""
        self.opening = self._link.loop.create_task(self._open(), name="connect to busd")

    async def _open(self) -> None:
        try:
            await self._connect_first()
        except BaseException as error:
            self._link.failure = error if isinstance(error, BusError) else BrokerUnavailable(str(error))
            if self._link.shm_context is not None:  # the event loop would keep it until the loop's end
                self._link.shm_context.close()
            raise
        finally:
            self.opening = None

    async def _connect_first(self) -> None:
        patience = Patience()
        while True:
            try:
                await self.connect(patience)
                return
            except NotNow as error:
                await asyncio.sleep(patience.pause_s(str(error)))

    async def connect(self, patience: Patience, *, may_start: bool = True) -> Connection:
        connection = Connection(
            self._link.shm_context,
            on_received=self._on_received,
            on_lost=self._lost,
            on_wrote=self._link.wrote,
        )
        self._link.connection = connection
        try:
            await connection.open(self._link.path, patience, may_start=may_start)
        except BaseException:
            self._link.connection = None
            raise
        self.hello = connection.hello
        self._link.connected(connection)
        return connection

    def _lost(self, reason: BusError) -> None:
        self._link.connection = None
        self._declarations.disconnected()
        if self._link.failure is None and self.opening is None:
            _log.warning(f"lost busd ({reason}); reconnecting")
            self.opening = self._link.loop.create_task(self._reconnect(), name="reconnect to busd")

    async def _reconnect(self) -> None:
        known_reason = ""
        lost_ns = monotonic_ns()
        if lost_ns - self._back_ns > _LASTED_NS:
            self._tries = 0
        try:
            while True:
                await asyncio.sleep(_RETRY_S[min(self._tries, len(_RETRY_S) - 1)])
                self._tries += 1
                # A user who started the daemon by hand may start it again, with its options. Leave time for
                # that.
                may_start = self.hello.background or monotonic_ns() - lost_ns > _USERS_TURN_NS
                try:
                    await self._declare_again(await self.connect(Patience(), may_start=may_start))
                except (OSError, BusError) as error:
                    log = _log.debug if str(error) == known_reason else _log.warning
                    known_reason = str(error)
                    log(f"busd is not back yet: {error}")
                    if self._link.connection is not None:
                        self._link.connection.close()
                        self._link.connection = None
                        self._declarations.disconnected()
                    continue
                self._back_ns = monotonic_ns()
                if self._link.connection is not None:  # else it was lost again
                    _log.info(f"busd is back (pid {self.hello.pid})")
                    return
        finally:
            self.opening = None

    async def when_connected(self, action: Callable[[Connection], Awaitable[T]]) -> T:
        while True:
            while self.opening is not None and self._link.failure is None:
                await asyncio.wait([self.opening])  # with any result
            if self._link.failure is not None:
                raise again(self._link.failure)
            if (connection := self._link.connection) is None:
                raise ConnectionClosed("the connection to busd is closed")
            if self._link.gathered or connection.outbox:
                self._link.hand_over()  # samples published before the action must leave before it
            try:
                return await action(connection)
            except ConnectionClosed:
                if self.opening is None:
                    raise

    async def _declare_again(self, connection: Connection) -> None:
        reporting = self._link.loop.create_task(
            self._report_progress(), name="tell how far the way back to busd is"
        )
        try:
            await self._declarations.declare_again(connection)
        finally:
            reporting.cancel()
        self._link.declared_again()

    async def _report_progress(self) -> None:
        """Log progress if the declarations take long. The caller cancels it when everything is declared."""
        while True:
            await asyncio.sleep(_REPORT_S)
            done, total = self._declarations.progress()
            _log.info(f"busd is back: {done} of {total} endpoints declared again")

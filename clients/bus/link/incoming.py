"""Distributes received data of a link: runs to subscriptions, control messages to their endpoints."""

import asyncio
from collections.abc import Collection, Iterable
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, Protocol

from bus.base.descriptor import Descriptor
from bus.errors import BusError, RemoteProtocolError
from bus.link.connection import Connection
from bus.link.declarations import Declarations, LinkEndpoint, gone
from bus.link.reports import Reports
from bus.wire import messages as m
from bus.wire.runs import Run
from bus.wire.session import Carried

if TYPE_CHECKING:  # most programs never watch the graph
    from bus.link.observing import GraphObservers

__all__ = ["Incoming"]


class _Link(Protocol):
    """The link that receives."""

    loop: asyncio.AbstractEventLoop
    connection: Connection | None
    failure: BusError | None
    observers: "GraphObservers | None"


class Incoming:
    """Distributes the items of each read. An error in a callback does not affect the rest of the read."""

    def __init__(self, link: _Link, declarations: Declarations, reports: Reports) -> None:
        self.is_receiving = False
        """Whether a part of a read was not handled yet."""
        self._link = link
        self._declarations = declarations
        self._reports = reports

    def received(self, items: Iterable[Any]) -> None:
        """Handle the runs and messages of one read."""
        received_ns = monotonic_ns()
        if (connection := self._link.connection) is not None:
            if received_ns > connection.late_ns:
                connection.note_standstill(received_ns)
            connection.heard_ns = received_ns
        if items.__class__ is tuple and self._deliver_lone(items, received_ns):
            return
        endpoints, touched = self._declarations.by_id, set[LinkEndpoint]()
        ending: BaseException | None = None
        self.is_receiving = True
        try:
            for item in items:
                try:
                    if item.__class__ is Run:
                        subscription = endpoints.get(item.endpoint, gone)()
                        if subscription is not None:  # else it was just closed
                            item.received_ns = received_ns
                            touched.add(subscription)
                            subscription.receive_run(item)
                    else:
                        self._handle(item)
                except RemoteProtocolError:
                    raise
                except Exception as error:
                    self._report_error(error)  # the rest of the read is for other endpoints
                except BaseException as error:
                    if self._link.failure is not None:
                        raise
                    # It ends this turn, perhaps the loop: the rest is queued now and delivered later.
                    ending = error
        finally:
            self.is_receiving = False
            if ending is None and touched:
                self.deliver(touched)
        if ending is not None:
            self._link.loop.call_soon(self.deliver, touched)
            raise ending

    def _deliver_lone(self, items: Any, received_ns: int) -> bool:
        """Call back at once for the only run of a read; returns whether the case was that simple."""
        run = items[0]
        endpoint = self._declarations.by_id.get(run.endpoint, gone)()
        if endpoint is None:
            return False
        run.received_ns = received_ns
        try:
            is_done = endpoint.receive_lone(run)
        except Exception as error:
            self._report_error(error)
            is_done = True
        if is_done:
            self._reports.add(endpoint)
        return is_done

    def deliver(self, endpoints: Collection[LinkEndpoint]) -> None:
        """Deliver to endpoints with new data. Callbacks go first, because the delay matters for them."""
        left = iter(endpoints)
        for endpoint in left:
            try:
                endpoint.wake()
            except Exception as error:
                self._report_error(error)
            except BaseException:  # it ends this turn, perhaps the loop: the others get the next turn
                self._link.loop.call_soon(self.deliver, list(left))
                raise
        if endpoints:
            self._reports.add_all(endpoints)

    def _report_error(self, error: Exception) -> None:
        self._link.loop.call_exception_handler(
            {"message": "handling what came from busd", "exception": error}
        )

    def _handle(self, message: Any) -> None:
        descriptors: tuple[Descriptor, ...] = ()
        if isinstance(message, Carried):
            message, descriptors = message
        if isinstance(message, m.Created):
            # At once, not when the request's task runs: the endpoint's messages may be in the same read.
            self._declarations.admit(message)
        connection = self._link.connection
        if connection is None or connection.resolve(message):
            return
        if isinstance(message, m.GraphChanged):
            if self._link.observers is not None:
                self._link.observers.change(message)
        elif isinstance(message, m.Namesake):
            self._declarations.warn_of_namesake(message)
        elif (endpoint := self._declarations.concerned(message)) is not None:
            endpoint.handle(message, descriptors)

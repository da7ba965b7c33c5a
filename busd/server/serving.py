"""Feeds the core with the data of peers, in turns, and charges each process for the work that it causes.

Owns the order: which peer is read, handled and gone on with next (`busd.core.turns`). A process within its
allowance is served at once, any other in its turn; until then its sockets are left alone. Must not know how
connections come about, nor how busd ends.
"""

import asyncio
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from time import monotonic_ns
from typing import Any, TypeAlias

from bus.base.ids import PeerId
from bus.errors import RemoteProtocolError
from bus.transport.stream_state import WRITE_OVER, ReadState
from bus.wire.messages import GetGraph, GetPeers, GetType, Observe
from bus.wire.runs import Run
from bus.wire.session import Carried
from busd.core.broker import Broker
from busd.core.turns import Party, Turns
from busd.core.work import LOOKS_PER_UNIT
from busd.server.alarm import Alarm
from busd.server.credentials import Credentials
from busd.server.effect_runner import EffectRunner
from busd.server.passing import pass_on
from busd.server.peer import PeerConnection

__all__ = ["Serving"]

_READ = 5
"""The cost of reading a socket, in the units of busd.core.work."""
_PART = 7
"""The extra cost of a read that makes no frame whole: the same bytes can be made to cost many reads."""
_BYTES_PER_UNIT = 8192
"""Bytes that are read then: for them, the system has to find memory first."""
_QUESTIONS = frozenset({GetGraph, GetType, GetPeers, Observe})
"""Messages that need not be handled once their process has gone; its samples are still routed."""
_CLOSED = ReadState.CLOSED  # looked up for every item
_Job: TypeAlias = PeerConnection | PeerId


class Serving:
    """Serves all open `connections`; `peers` are the connections that the core knows, by id."""

    def __init__(
        self,
        broker: Broker,
        peers: Mapping[PeerId, PeerConnection],
        connections: Collection[PeerConnection],
        effects: EffectRunner,
        alarm: Alarm,
    ) -> None:
        self._broker = broker
        self._peers = peers
        self._connections = connections
        self._effects = effects
        self._alarm = alarm
        self._loop = asyncio.get_running_loop()
        self._turns: Turns[_Job] = Turns()
        self._is_scheduled = False
        """The next turn is scheduled, or one is being served."""
        self._payer: Party[_Job] | None = None
        self._gone: dict[PeerId, Party[_Job]] = {}
        """Peers that have gone, and that the broker has yet to forget."""
        self._early: set[PeerConnection] = set()
        """Parked, without a place in the line: checked again when something has gone or is read again."""

    def party(self, who: Credentials) -> Party[_Job]:
        """The party that a connection of that process belongs to."""
        return self._turns.party((who.uid, who.process))

    # --- a connection asks (busd.server.peer.Scheduler)

    def may_read(self, connection: PeerConnection) -> bool:
        """Whether the connection's socket may be read now; if not, it gets its turn."""
        if connection.is_choked:
            connection.wrote()  # it may have gone meanwhile: then this is the end of its data
        if (
            connection.items is None
            and not (connection.is_early and self._is_early(connection))
            and self._turns.may_go(monotonic_ns(), connection.party)
        ):
            return True
        self.wait(connection)
        return False

    def may_write(self, connection: PeerConnection) -> bool:
        """Whether its party may be served now; if not, it gets its turn."""
        if self._turns.may_go(monotonic_ns(), connection.party):
            return True
        self.wait(connection)
        return False

    def receive(self, connection: PeerConnection, count: int) -> None:
        """Handle the `count` bytes that were read, as far as the party's allowance lets it."""
        party, meter, session = connection.party, self._broker.meter, connection.stream.session
        self._payer = party
        meter.left = party.left - _READ
        try:
            session.reader.came(count)
            if not pass_on(self._broker, self._peers, connection):
                self._handle(connection, session.items())
                if session.reader.is_unfinished:
                    meter.left -= _PART + count // _BYTES_PER_UNIT
        finally:
            party.left = meter.left
            self._payer = None

    def resume(self, connection: PeerConnection) -> None:
        """The connection is no longer held: go on with data read before."""
        if connection.items is not None and not connection.is_held:
            self.wait(connection)

    def before_write(self, connection: PeerConnection) -> None:
        """The socket takes bytes again: first drop expired samples."""
        connection.wrote()
        with self._metered(connection.party):
            self._effects.carry_out(self._broker.expire(monotonic_ns(), connection.id))
            self._effects.flush()
        self._alarm.set()

    # --- connections come and go

    def wait(self, connection: PeerConnection) -> None:
        """Have the connection served in the turns of its party; until then its socket is left alone."""
        if not connection.is_parked:
            connection.is_parked = True
            connection.stream.hold()
        self._line_up(connection.party, connection)

    def serve_later(self, peer: PeerId) -> None:
        """Go on with the core's work for that peer, present or gone, in turns of its party."""
        if connection := self._peers.get(peer):
            self.wait(connection)
        else:
            self._line_up(self._gone[peer], peer)

    def remove(self, connection: PeerConnection) -> None:
        """The connection is lost: have the core forget its peer."""
        self._gone[connection.id] = connection.party
        try:
            with self._metered(connection.party):
                self._effects.carry_out(self._broker.detach(monotonic_ns(), connection.id))
                self._effects.flush()
        finally:
            self._settle(connection.id)
        self._alarm.set()

    def has_removed(self, connection: PeerConnection) -> None:
        """The core itself has forgotten the peer, or begun to."""
        self._gone[connection.id] = connection.party
        self._settle(connection.id)

    def check_early(self) -> None:
        """Line up the early connections: the entities that they wait for may have gone."""
        early, self._early = self._early, set()
        for connection in early:
            self._line_up(connection.party, connection)

    def _settle(self, peer: PeerId) -> None:
        """If the core has forgotten a peer that has gone, no connection need wait for that any more."""
        if peer not in self._broker.tasks.unfinished and self._gone.pop(peer, None) is not None:
            self.check_early()

    def _is_early(self, connection: PeerConnection) -> bool:
        """Entities of its process over an earlier connection have to be removed first."""
        if connection.is_early:
            party = connection.party
            connection.is_early = party in self._gone.values() or any(
                one.party is party and (one.is_parked or one.is_held) and one.stream.has_hung_up
                for one in self._connections
                if one.id < connection.id  # or two would wait for each other
            )
        return connection.is_early

    # --- turns

    def _line_up(self, party: Party[_Job], job: _Job) -> None:
        if not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon(self._serve)
        self._turns.wait(party, job)

    def _serve(self) -> None:
        """One turn; before the next one the event loop looks at its sockets."""
        turns = self._turns
        party = turns.begin()
        try:
            while (job := turns.next_job(party)) is not None:
                if isinstance(job, PeerConnection):
                    self._serve_connection(job)
                else:
                    with self._metered(party):
                        self._go_on(job)
                        self._effects.flush()
        finally:  # whatever went wrong for one party, the others get their turns
            turns.end(party)
            self._is_scheduled = bool(turns)
            if turns:
                self._loop.call_soon(self._serve)
        if turns:
            os.sched_yield()  # a peer that was just sent something may run now, before this process sleeps
        if self._broker.timers.earliest_ns < self._alarm.due_ns:
            self._alarm.set()

    def _serve_connection(self, connection: PeerConnection) -> None:
        """First send its queued data and go on with begun work, then handle data read before, then read."""
        party = connection.party
        connection.stream.write_on()
        connection.wrote()
        with self._metered(party):
            self._go_on(connection.id)
            self._effects.flush(connection)
        may_be_more = False
        if self._is_early(connection):
            party.left -= 1 + len(self._connections) // LOOKS_PER_UNIT
            self._early.add(connection)
            return
        if party.left > 0 and not connection.is_held and connection.id not in self._broker.tasks.unfinished:
            items, connection.items = connection.items, None
            if items is None:
                may_be_more = connection.stream.read_on()
            else:
                with self._metered(party):
                    self._handle(connection, items)
                may_be_more = connection.stream.reading is not _CLOSED
        else:
            may_be_more = not connection.is_held
        if may_be_more:
            self._line_up(party, connection)
        elif not self._turns.is_waiting(connection):
            connection.is_parked = False
            connection.stream.release()
            self.check_early()

    def _go_on(self, peer: PeerId) -> None:
        """Go on with the work that the broker has begun for a peer, present or gone."""
        if self._broker.tasks.has_work(peer):
            now_ns = monotonic_ns()
            try:
                self._effects.carry_out(self._broker.go_on(now_ns, peer))
            finally:
                self._settle(peer)
            self._trim(now_ns)

    def _trim(self, now_ns: int, last: PeerConnection | None = None) -> bool:
        """Bound the queues that are too full, after the sockets took what they could; returns whether there
        were any.
        """
        if not self._broker.is_overfull:
            return False
        self._effects.flush(last)
        self._effects.carry_out(self._broker.trim(now_ns))
        return True

    def _handle(self, connection: PeerConnection, items: Iterable[Any]) -> None:
        """Hand the broker the messages, one by one; messages wait if there is no time for them."""
        broker, effects, peer = self._broker, self._effects, connection.id
        meter, stream = broker.meter, connection.stream
        now_ns, runs, is_swamped = monotonic_ns(), 0, False
        left = iter(items)
        try:
            for item in left:
                if item.__class__ is Run:
                    runs += 1
                    if routed := broker.route(now_ns, peer, item):
                        effects.carry_out(routed)
                    if broker.is_overfull:
                        is_swamped = self._trim(now_ns, connection)
                elif item.__class__ is Carried:
                    descriptors = connection.accept(item)
                    effects.carry_out(broker.handle(now_ns, peer, item.message, descriptors))
                elif not (item.__class__ in _QUESTIONS and stream.writing in WRITE_OVER):
                    effects.carry_out(broker.handle(now_ns, peer, item))
                if stream.reading is _CLOSED:
                    break
                if meter.left <= 0 or connection.is_held or peer in broker.tasks.unfinished:
                    connection.items = left
                    self.resume(connection)
                    break
        except RemoteProtocolError as error:
            connection.refuse(str(error))
        finally:
            if effects.dirty:
                effects.flush(connection)
            if runs:
                broker.routing_times.add(runs, monotonic_ns() - now_ns)
            if broker.timers.earliest_ns < self._alarm.due_ns:
                self._alarm.set()
            if is_swamped:
                os.sched_yield()  # more arrives than is taken: let processes that wake up beside us run

    @contextmanager
    def _metered(self, party: Party[_Job]) -> Iterator[None]:
        """Charge the work done inside to `party`. Exception: work done within another party's work is charged
        to that party.
        """
        if self._payer is not None:
            yield
            return
        meter, self._payer = self._broker.meter, party
        meter.left = party.left
        try:
            yield
        finally:
            party.left = meter.left
            self._payer = None

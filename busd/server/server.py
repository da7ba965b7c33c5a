"""Feeds the core with what peers send, in turns, and carries out its effects. Decides nothing itself."""

import asyncio
import logging
import os
import socket
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic_ns
from typing import Any, TypeAlias

from bus.base.ids import PeerId
from bus.errors import ConfigurationError, RemoteProtocolError
from bus.transport.stream_state import WRITE_OVER, ReadState
from bus.wire.messages import (
    Done,
    GetGraph,
    GetPeers,
    GetType,
    Hello,
    Message,
    Observe,
    Refused,
    encode_frame,
)
from bus.wire.runs import Run
from bus.wire.session import Carried
from busd.core.access import Access
from busd.core.broker import Broker
from busd.core.effects import Disconnect, Effect, Flush, Later, Note, Pause, Reload, Restart, Send, Stop
from busd.core.limits import Limits, TopicRule
from busd.core.timers import NEVER_NS
from busd.core.turns import BUDGET, Party, Turns
from busd.core.work import LOOKS_PER_UNIT, UNLIMITED
from busd.process.repetitions import Repetitions
from busd.server.admission import Admission
from busd.server.credentials import Credentials
from busd.server.listener import Listener
from busd.server.passing import pass_on
from busd.server.peer import PeerConnection, greeting
from busd.server.shutdown import Drain

_log = logging.getLogger("busd")

_LATE_NS = 250_000_000
"""A timer that is so late shows that this process was stopped or starved."""
_GRACE_NS = 50_000_000

_READ, _WRITE = 5, 4
"""The cost of reading a socket, or of looking what to send, in the units of busd.core.work."""
_PART = 7
"""What a read costs besides if it makes no frame whole: so the same bytes can be made to cost many reads."""
_BYTES_PER_UNIT = 8192
"""Bytes that are read then: for them, the system has to find memory first."""
_QUESTIONS = frozenset({GetGraph, GetType, GetPeers, Observe})
"""Messages that need not be handled once their process has gone; what it has published is still routed."""
_CLOSED = ReadState.CLOSED  # looked up for every item
_Job: TypeAlias = PeerConnection | PeerId


class Server:
    """Serves `listener` until `stop`, which closes it.

    `idle_s`: stop by itself after so many seconds without a connection (None: never). Such a busd
    was started in the background by a client. The rest answers requests over the wire: `find_fault` gives the
    reason against a restart, or ""; `reload` what has changed, or raises ConfigurationError. `is_restarting`:
    the end is a restart; valid once `stopped` is done.
    """

    def __init__(
        self,
        listener: Listener,
        broker: Broker,
        *,
        idle_s: float | None = None,
        find_fault: Callable[[], Awaitable[str]] | None = None,
        reload: Callable[[], str] | None = None,
    ) -> None:
        self.limits: Limits = broker.limits
        self.is_background = idle_s is not None
        self.began_ns = monotonic_ns()
        self.stopped: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._broker = broker
        self._connections: set[PeerConnection] = set()
        self._peers: dict[PeerId, PeerConnection] = {}
        self._turns: Turns[_Job] = Turns()
        self._is_serving = False
        self._payer: Party[_Job] | None = None
        self._gone: dict[PeerId, Party[_Job]] = {}
        """Peers that have gone, and that the broker has yet to forget."""
        self._early: set[PeerConnection] = set()
        """Parked, without a place in the line: looked at again when something has gone or is read again."""
        self._dirty: set[PeerConnection] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = NEVER_NS
        self._wake_ns = 0
        self._is_grace_over = False
        self._idle_s = idle_s
        self._idle_timer: asyncio.TimerHandle | None = None
        self.is_restarting = False
        self._find_fault = find_fault
        self._reload = reload
        self._restart: asyncio.Task[None] | None = None
        self._refusals = Repetitions()
        self._is_ending = False
        self._drain: Drain | None = None
        self._admission = Admission(listener.socket, self)
        self._watch_idle()

    def stop(self, reason: str, *, restart: bool = False) -> None:
        """Stop listening, and close the connections when what was sent has come; see busd.server.shutdown.

        On a `restart` clients that connect meanwhile wait for the next busd, which gets the listening socket.
        A restart that has begun can still be turned into an end.
        """
        if self._is_ending:
            if self.is_restarting and not restart:
                self.is_restarting = False
                self._listener.close()
            return
        self._is_ending, self.is_restarting = True, restart
        self._admission.close()
        for connection in tuple(self._connections):
            connection.end_pause()
        if not restart:
            self._listener.close()  # first of all: clients find no busd from now on, and start one
        for timer in (self._timer, self._idle_timer):
            if timer is not None:
                timer.cancel()
        self._drain = Drain(
            self._connections,
            f"busd {'restarts' if restart else 'stops'}: {reason}",
            longest_s=self.limits.drain_s,
            on_heard=self._say_farewell,
            on_end=lambda: self.stopped.set_result(reason),
        )

    def stop_now(self, reason: str) -> None:
        """As `stop`; the second time without waiting for peers."""
        if self._drain is not None and not self.is_restarting:
            self._drain.end()
        self.stop(reason)

    def reconfigure(self, limits: Limits, rules: tuple[TopicRule, ...], access: Access) -> None:
        """Go by these from now on."""
        self.limits = limits
        self._broker.meter.left = UNLIMITED
        for connection in self._connections:
            connection.stream.session.allow(limits.message_bytes)
        self._carry_out(self._broker.reconfigure(monotonic_ns(), limits, rules, access))
        self._flush()
        self._arm_timer()

    # --- PeerHost

    def may_read(self, connection: PeerConnection) -> bool:
        """Whether the connection's socket may be read now; if not, it gets its turn."""
        if connection.is_choked:
            connection.wrote()  # it may have gone meanwhile, so that this is the end of what it has sent
        if (
            connection.items is None
            and not (connection.is_early and self._is_early(connection))
            and self._turns.may_go(monotonic_ns(), connection.party)
        ):
            return True
        self._wait(connection)
        return False

    def may_write(self, connection: PeerConnection) -> bool:
        """Whether its party may be served now; if not, it gets its turn."""
        if self._turns.may_go(monotonic_ns(), connection.party):
            return True
        self._wait(connection)
        return False

    def before_write(self, connection: PeerConnection) -> None:
        """The connection takes bytes again: drop samples that are too old before the next are sent."""
        connection.wrote()
        with self._metered(connection.party):
            self._carry_out(self._broker.expire(monotonic_ns(), connection.id))
            self._flush()
        self._arm_timer()

    def receive(self, connection: PeerConnection, count: int) -> None:
        """Handle the `count` bytes that were read, as far as the party's allowance goes."""
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
        """The connection is no longer held: go on with what was read before."""
        if connection.items is not None and not connection.is_held:
            self._wait(connection)

    def hear(self, connection: PeerConnection) -> None:
        """A peer that is not read now takes what is sent to it: that is a sign of life."""
        self._carry_out(self._broker.hear(monotonic_ns(), connection.id))
        self._flush()

    def lose(self, connection: PeerConnection, reason: str, *, is_cut: bool) -> None:
        if connection not in self._connections:
            return
        self._connections.discard(connection)
        level, what = (logging.WARNING, "cut off") if is_cut else (logging.DEBUG, "lost")
        pid = connection.credentials.pid
        _log.log(level, "%s pid %d: %s", what, pid, reason, extra={"peer": pid})
        if self._is_ending:
            self._look_at_early()
            return  # what it has sent still goes to the others, as if it were there
        del self._peers[connection.id]
        self._gone[connection.id] = connection.party
        with self._metered(connection.party):
            self._carry_out(self._broker.detach(monotonic_ns(), connection.id))
            self._flush()
        self._arm_timer()
        self._watch_idle()

    # --- turns

    def _wait(self, connection: PeerConnection) -> None:
        """Have the connection served in the turns of its party; until then its socket is left alone."""
        if not connection.is_parked:
            connection.is_parked = True
            connection.stream.hold()
        self._line_up(connection.party, connection)

    def _is_early(self, connection: PeerConnection) -> bool:
        """What its process had over an earlier connection has to be removed first."""
        if connection.is_early:
            party = connection.party
            connection.is_early = party in self._gone.values() or any(
                one.party is party and (one.is_parked or one.is_held) and one.stream.has_hung_up
                for one in self._connections
                if one.id < connection.id  # or two would wait for each other
            )
        return connection.is_early

    def _look_at_early(self) -> None:
        """Line up the early ones: what they wait for may have gone."""
        early, self._early = self._early, set()
        for connection in early:
            self._line_up(connection.party, connection)

    def _line_up(self, party: Party[_Job], job: _Job) -> None:
        if not self._is_serving:
            self._is_serving = True
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
                        self._flush()
        finally:  # whatever went wrong for one of them, the others get their turns
            turns.end(party)
            self._is_serving = bool(turns)
            if turns:
                self._loop.call_soon(self._serve)
        if turns:
            os.sched_yield()  # a peer that was just sent something may run now, before this process sleeps
        if self._broker.timers.earliest_ns < self._timer_ns:
            self._arm_timer()

    def _serve_connection(self, connection: PeerConnection) -> None:
        """First send what waits for it and go on with what was begun, then handle what was read, then
        read."""
        party = connection.party
        connection.stream.write_on()
        connection.wrote()
        with self._metered(party):
            self._go_on(connection.id)
            self._flush(connection)
        may_be_more = False
        if self._is_early(connection):
            party.left -= 1 + len(self._connections) // LOOKS_PER_UNIT
            self._early.add(connection)
            return
        if party.left > 0 and not connection.is_held and connection.id not in self._broker.unfinished:
            items, connection.items = connection.items, None
            if items is None:
                may_be_more = connection.stream.read_on()
            else:
                with self._metered(party):
                    self._handle(connection, items)
                may_be_more = connection.stream.reading is not ReadState.CLOSED
        else:
            may_be_more = not connection.is_held
        if may_be_more:
            self._line_up(party, connection)
        elif not self._turns.is_waiting(connection):
            connection.is_parked = False
            connection.stream.release()
            self._look_at_early()

    def _go_on(self, peer: PeerId) -> None:
        """Go on with what the broker has begun for a peer, or for one that has gone."""
        if self._broker.has_work(peer):
            now_ns = monotonic_ns()
            self._carry_out(self._broker.go_on(now_ns, peer))
            self._trim(now_ns)

    def _trim(self, now_ns: int, last: PeerConnection | None = None) -> bool:
        """Bound the queues that are too full, after what can be sent was sent; returns whether any was."""
        if not self._broker.is_overfull:
            return False
        self._flush(last)
        self._carry_out(self._broker.trim(now_ns))
        return True

    def _handle(self, connection: PeerConnection, items: Iterable[Any]) -> None:
        """Hand the broker what came, one by one; what there is no time for waits."""
        broker, peer, meter, stream = self._broker, connection.id, self._broker.meter, connection.stream
        now_ns, runs, is_swamped = monotonic_ns(), 0, False
        left = iter(items)
        try:
            for item in left:
                if item.__class__ is Run:
                    runs += 1
                    effects = broker.route(now_ns, peer, item)
                    if effects:
                        self._carry_out(effects)
                    if broker.is_overfull:
                        is_swamped = self._trim(now_ns, connection)
                elif item.__class__ is Carried:
                    descriptors = connection.accept(item)
                    self._carry_out(broker.handle(now_ns, peer, item.message, descriptors))
                elif not (item.__class__ in _QUESTIONS and stream.writing in WRITE_OVER):
                    self._carry_out(broker.handle(now_ns, peer, item))
                if stream.reading is _CLOSED:
                    break
                if meter.left <= 0 or connection.is_held or peer in broker.unfinished:
                    connection.items = left
                    self.resume(connection)
                    break
        except RemoteProtocolError as error:
            connection.refuse(str(error))
        finally:
            if self._dirty:
                self._flush(connection)
            if runs:
                broker.routing_times.add(runs, monotonic_ns() - now_ns)
            if broker.timers.earliest_ns < self._timer_ns:
                self._arm_timer()
            if is_swamped:
                os.sched_yield()  # more comes than is taken: let processes that wake up beside us run

    @contextmanager
    def _metered(self, party: Party[_Job]) -> Iterator[None]:
        """Charge the work done inside to `party`; where it is done within another party's, to that one."""
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

    # --- effects

    def _carry_out(self, effects: list[Effect]) -> None:
        overfull: list[PeerConnection] = []
        encoded, frame = None, b""  # a change of the graph is the same message for all observers
        for effect in effects:
            if effect.__class__ is Flush:  # the hot one: this is cheaper than `match`
                if connection := self._peers.get(effect.peer):
                    connection.stream.outbox.make_ready(effect.queue)
                    self._dirty.add(connection)
                continue
            match effect:
                case Send(peer, message, descriptors):
                    if connection := self._peers.get(peer):
                        if message is not encoded:
                            encoded, frame = message, encode_frame(message)
                        connection.put(frame, descriptors)
                        self._dirty.add(connection)
                        if connection.is_user_over:
                            overfull.append(connection)
                case Later(peer):
                    if connection := self._peers.get(peer):
                        self._wait(connection)
                    else:
                        self._line_up(self._gone[peer], peer)
                case Disconnect(peer, _):
                    if connection := self._peers.pop(peer, None):
                        self._gone[peer] = connection.party
                        self._connections.discard(connection)
                        connection.close()
                        self._watch_idle()
                case Pause(peer, pause_ns):
                    connection = self._peers.get(peer)
                    if connection is not None and connection.stream.writing not in WRITE_OVER:
                        connection.pause(pause_ns / 1e9)
                case Note(level, text):
                    _log.log(level, "%s", text)
                case Stop(reason):
                    self._flush()
                    self.stop(reason)
                case Restart():
                    self._restart = self._loop.create_task(self._try_restart(effect, self._restart))
                case Reload(peer, request):
                    self._loop.call_soon(self._try_reload, peer, request)  # it has effects of its own
        if self._gone:
            before = len(self._gone)
            self._gone = {
                peer: party for peer, party in self._gone.items() if peer in self._broker.unfinished
            }
            if len(self._gone) < before:
                self._look_at_early()
        for connection in overfull:  # only now: its end has effects, which come after these
            self._relieve(connection)

    def _relieve(self, connection: PeerConnection) -> None:
        """Too many control frames wait for a user's peers: cut off the one for which most wait."""
        connection.stream.flush()
        if connection.is_user_over:
            whole = connection.account.parent
            same_user = (one for one in self._peers.values() if one.account.parent is whole)
            max(same_user, key=lambda one: one.account.used, default=connection).relieve()

    def _flush(self, last: PeerConnection | None = None) -> None:
        """Send to every peer that something waits for; last to `last`, whose message was handled.

        A subscription that learns that it exists may count on every publisher knowing it by then.
        """
        dirty, meter = self._dirty, self._broker.meter
        is_last_dirty = last in dirty
        if last is not None:
            dirty.discard(last)
        while dirty:
            connection = dirty.pop()
            meter.left -= _WRITE + connection.stream.flush()
            if connection.is_choked:
                connection.wrote()
        if last is not None and is_last_dirty:
            meter.left -= _WRITE + last.stream.flush()
            if last.is_choked:
                last.wrote()

    def _arm_timer(self) -> None:
        due_ns = self._broker.timers.earliest_ns
        if due_ns >= self._timer_ns or self._is_ending:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_ns = due_ns
        self._wake_at(due_ns)

    def _wake_at(self, due_ns: int) -> None:
        now_ns = monotonic_ns()
        self._wake_ns = max(now_ns, due_ns)
        self._timer = self._loop.call_later((self._wake_ns - now_ns) / 1e9, self._tick)

    def _tick(self) -> None:
        now_ns = monotonic_ns()
        if now_ns - self._wake_ns > _LATE_NS and not self._is_grace_over:
            # It was this process that did not run, not the peers whose leases ended: read first what they
            # sent meanwhile.
            self._is_grace_over = True
            self._wake_at(now_ns + _GRACE_NS)
            return
        self._is_grace_over = False
        self._timer_ns = NEVER_NS
        self._broker.meter.left = BUDGET  # as for a party: what is due and not done is due again at once
        self._carry_out(self._broker.tick(now_ns))
        self._flush()
        self._arm_timer()

    # --- the end

    async def _try_restart(self, asked: Restart, before: asyncio.Task[None] | None) -> None:
        if self._find_fault is None:
            fault = "this busd can't restart"
        elif self._is_ending or (before is not None and not before.done()):
            fault = "busd is about to end"
        else:
            fault = await self._find_fault()
        if fault:
            self._refusals.log(logging.ERROR, f"no restart: {fault}")
            self._answer(asked.peer, Refused(request=asked.request, text=fault))
        else:
            self._answer(asked.peer, Done(request=asked.request))
            self.stop(asked.reason, restart=True)

    def _try_reload(self, peer: PeerId, request: int) -> None:
        try:
            text = self._reload() if self._reload is not None else ""
            self._answer(peer, Done(request=request, text=text))
        except ConfigurationError as error:
            self._answer(peer, Refused(request=request, text=str(error)))

    def _answer(self, peer: PeerId, answer: Message) -> None:
        if connection := self._peers.get(peer):
            connection.send(answer)
            connection.stream.flush()

    def _say_farewell(self) -> None:
        self._carry_out(self._broker.farewell(monotonic_ns()))
        self._flush()

    # --- AdmissionHost

    @property
    def handshake_s(self) -> float:
        return self.limits.handshake_s

    def greeting(self) -> bytes:
        return greeting(self)

    def why_turned_away(self, who: Credentials) -> str:
        return self._broker.why_turned_away(who.uid, who.groups)

    def arrive(self, who: Credentials, said_ns: int) -> int:
        return self._broker.arrive(monotonic_ns(), who.uid, said_ns)

    def why_no_room(self, who: Credentials) -> tuple[str, bool]:
        of_user = sum(one.credentials.uid == who.uid for one in self._connections)
        return self._broker.turn_away(
            monotonic_ns(), who.uid, connections=len(self._connections) + 1, of_user=of_user + 1
        )

    def come_to_nothing(self, who: Credentials, *, for_want_of_room: bool) -> tuple[bool, int]:
        return self._broker.come_to_nothing(monotonic_ns(), who.uid, for_want_of_room=for_want_of_room)

    def let_in(self, sock: socket.socket, who: Credentials, hello: Hello) -> None:
        peer = self._broker.attach(
            monotonic_ns(), hello, pid=who.pid, uid=who.uid, gids=who.groups, process=who.process
        )
        party = self._turns.party((who.uid, who.process))
        accounts = self._broker.accounts(peer)
        connection = self._peers[peer] = PeerConnection(self, sock, who, hello, peer, party, *accounts)
        self._connections.add(connection)
        _log.debug("%s (pid %d) connected", hello.program, who.pid, extra={"peer": who.pid})
        connection.greet()
        self._arm_timer()
        self._watch_idle()

    # --- connections

    def _watch_idle(self) -> None:
        if self._idle_s is None or self._is_ending:
            return
        if self._idle_timer is not None:
            self._idle_timer.cancel()
            self._idle_timer = None
        if not self._connections:
            self._idle_timer = self._loop.call_later(self._idle_s, self._end_idleness, self._idle_s)

    def _end_idleness(self, idle_s: float) -> None:
        # Connections that came while this process was held up: libuv looks at timers first.
        if self._admission.accept_some(1) or not self._admission.is_empty:
            self._watch_idle()
        elif not self._connections:
            self.stop(f"idle for {idle_s:g} s")

"""Listens, feeds the broker core with what comes, and carries out its effects. Decides nothing itself."""

import asyncio
import logging
from collections.abc import Iterable
from time import monotonic_ns
from typing import Any

from bus.errors import RemoteProtocolError
from bus.ids import PeerId
from bus.wire.messages import Hello
from bus.wire.runs import Run
from bus.wire.session import Carried
from busd.core.broker import Broker
from busd.core.effects import Disconnect, Effect, Flush, Note, Send, Stop
from busd.core.limits import Limits
from busd.core.timers import NEVER_NS
from busd.credentials import peer_credentials
from busd.listener import Listener
from busd.peer import PeerConnection

_log = logging.getLogger("busd")

_LATE_NS = 250_000_000
"""A timer that comes so late says that this process was stopped or starved."""
_GRACE_NS = 50_000_000


class Server:
    """Serves `listener` until `stop`, which closes it.

    `idle_s`: stop by itself after so many seconds without a connection (None: never). One that does so was
    started in the background by a client.
    """

    def __init__(self, listener: Listener, broker: Broker, *, idle_s: float | None = None) -> None:
        self.limits: Limits = broker.limits
        self.is_background = idle_s is not None
        self.stopped: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._broker = broker
        self._connections: set[PeerConnection] = set()
        self._peers: dict[PeerId, PeerConnection] = {}
        self._dirty: set[PeerConnection] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = NEVER_NS
        self._wake_ns = 0
        self._is_grace_over = False
        self._idle_s = idle_s
        self._idle_timer: asyncio.TimerHandle | None = None
        self._loop.add_reader(listener.socket.fileno(), self._accept)
        self._watch_idle()

    def stop(self, reason: str) -> None:
        """Stop listening, tell nobody, close every connection after sending what it takes."""
        if self.stopped.done():
            return
        self._loop.remove_reader(self._listener.socket.fileno())
        self._listener.close()  # first of all: whoever connects from now on finds no busd, and starts one
        for timer in (self._timer, self._idle_timer):
            if timer is not None:
                timer.cancel()
        for connection in tuple(self._connections):
            connection.close()
        self.stopped.set_result(reason)

    # --- PeerHost

    def greet(self, connection: PeerConnection, hello: Hello) -> PeerId:
        who = connection.credentials
        peer = self._broker.attach(monotonic_ns(), hello, pid=who.pid, uid=who.uid)
        self._peers[peer] = connection
        _log.debug("%s (pid %d) connected", hello.program, who.pid)
        self._arm_timer()
        return peer

    def receive(self, connection: PeerConnection, items: Iterable[Any]) -> None:
        broker, peer = self._broker, connection.id
        assert peer is not None
        now_ns = monotonic_ns()
        try:
            for item in items:
                if item.__class__ is Run:
                    effects = broker.route(now_ns, peer, item)
                    if effects and not (items.__class__ is list and self._pass_on(effects)):
                        self._carry_out(effects)
                    if broker.is_overfull:
                        self._flush(connection)
                        self._carry_out(broker.trim(now_ns))
                elif item.__class__ is Carried:
                    descriptors = connection.accept(item)
                    self._carry_out(broker.handle(now_ns, peer, item.message, descriptors))
                else:
                    self._carry_out(broker.handle(now_ns, peer, item))
                if connection.stream.is_closed:
                    break
        except RemoteProtocolError as error:
            connection.refuse(str(error))
        finally:
            if self._dirty:
                self._flush(connection)
            if broker.timers.earliest_ns < self._timer_ns:
                self._arm_timer()

    def lose(self, connection: PeerConnection, reason: str, *, is_cut: bool) -> None:
        if connection not in self._connections:
            return
        self._connections.discard(connection)
        level, what = (logging.WARNING, "cut off") if is_cut else (logging.DEBUG, "lost")
        _log.log(level, "%s pid %d: %s", what, connection.credentials.pid, reason)
        if connection.id is not None and self._peers.pop(connection.id, None) is not None:
            self._carry_out(self._broker.detach(monotonic_ns(), connection.id))
            self._flush()
            self._arm_timer()
        self._watch_idle()

    # --- effects

    def _pass_on(self, effects: list[Effect]) -> bool:
        """A read brought one run, and it is for one subscription whose process takes it at once.

        At a moderate rate all are like that; the outbox is most of what the broker's part would cost.
        """
        flush = effects[0]
        if len(effects) > 1 or flush.__class__ is not Flush or self._broker.is_overfull:
            return False
        connection = self._peers.get(flush.peer)
        if connection is None or not connection.stream.is_idle:
            return False
        head, body = flush.queue.pop_frame()
        connection.stream.send_now([head, body], len(head) + len(body))
        return True

    def _carry_out(self, effects: list[Effect]) -> None:
        choked: list[PeerConnection] = []
        for effect in effects:
            if effect.__class__ is Flush:  # the hot one: cheaper to ask for than to match
                if connection := self._peers.get(effect.peer):
                    connection.stream.outbox.make_ready(effect.queue)
                    self._dirty.add(connection)
                continue
            match effect:
                case Send(peer, message, descriptors):
                    if connection := self._peers.get(peer):
                        if connection.is_choked:  # before this one: a single message may be longer
                            choked.append(connection)
                        connection.send(message, descriptors)
                        self._dirty.add(connection)
                case Disconnect(peer, _):
                    if connection := self._peers.pop(peer, None):
                        self._connections.discard(connection)
                        connection.close()
                        self._watch_idle()
                case Note(level, text):
                    _log.log(level, "%s", text)
                case Stop(reason):
                    self._flush()
                    self.stop(reason)
        for connection in choked:  # only now: its end has effects, which come after these
            connection.relieve()

    def _flush(self, last: PeerConnection | None = None) -> None:
        """Send to all that something waits for; to `last`, whose message this is about, after the others.

        A subscription that learns that it exists may count on every publisher having been told of it.
        """
        dirty = self._dirty
        is_last_dirty = last in dirty
        if last is not None:
            dirty.discard(last)
        while dirty:
            dirty.pop().stream.flush()
        if last is not None and is_last_dirty:
            last.stream.flush()

    def _arm_timer(self) -> None:
        due_ns = self._broker.timers.earliest_ns
        if due_ns >= self._timer_ns or self.stopped.done():
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
            # We did not run, rather than those whose leases have ended: hear first what they said meanwhile.
            self._is_grace_over = True
            self._wake_at(now_ns + _GRACE_NS)
            return
        self._is_grace_over = False
        self._timer_ns = NEVER_NS
        self._carry_out(self._broker.tick(now_ns))
        self._flush()
        self._arm_timer()

    # --- connections

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.socket.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:
            # Out of descriptors: let those who are connected go on, and look again a little later.
            _log.error("cannot accept a connection: %s", error)
            self._loop.remove_reader(self._listener.socket.fileno())
            self._loop.call_later(0.5, self._resume_accepting)
            return
        sock.setblocking(False)
        connection = PeerConnection(self, sock, peer_credentials(sock))
        self._connections.add(connection)
        self._watch_idle()
        if len(self._connections) > self.limits.connections:
            connection.refuse(
                f"connections: {self.limits.connections} of {self.limits.connections} in use; "
                "busd's limit can be raised in busd.toml"
            )
            return
        connection.stream.before_write(lambda: self._before_write(connection))

    def _resume_accepting(self) -> None:
        if not self.stopped.done():
            self._loop.add_reader(self._listener.socket.fileno(), self._accept)

    def _before_write(self, connection: PeerConnection) -> None:
        if connection.id is not None:
            self._carry_out(self._broker.expire(monotonic_ns(), connection.id))
            self._flush()
            self._arm_timer()

    def _watch_idle(self) -> None:
        if self._idle_s is None or self.stopped.done():
            return
        if self._idle_timer is not None:
            self._idle_timer.cancel()
            self._idle_timer = None
        if not self._connections:
            self._idle_timer = self._loop.call_later(self._idle_s, self._end_idleness, self._idle_s)

    def _end_idleness(self, idle_s: float) -> None:
        self._accept()  # who came while this process was held up: libuv looks at timers first
        if not self._connections:
            self.stop(f"idle for {idle_s:g} s")

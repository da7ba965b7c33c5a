"""Puts the parts of the daemon together, lets connections in and out, and begins the end.

`busd.server.serving` feeds the core, and `busd.server.effect_runner` carries out its effects. The events that
end busd, and how, are a table: `busd.server.life`.
"""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable
from functools import partial
from time import monotonic_ns

from bus.base.ids import PeerId
from bus.wire.messages import Hello, Message
from busd.core.access import Access
from busd.core.broker import Broker
from busd.core.effects import Reload, Restart
from busd.core.limits import Limits, TopicRule
from busd.core.turns import BUDGET
from busd.core.work import UNLIMITED
from busd.server.admission import Admission
from busd.server.alarm import Alarm
from busd.server.credentials import Credentials
from busd.server.effect_runner import EffectRunner
from busd.server.life import Life, LifeEvent, LifeState
from busd.server.listener import Listener
from busd.server.peer import PeerConnection, greeting
from busd.server.requests import Requests
from busd.server.serving import Serving
from busd.server.shutdown import Drain

_log = logging.getLogger("busd")


class Server:
    """Serves `listener` until `stop`, which closes it.

    `idle_s`: stop by itself after so many seconds without a connection (None: never). Such a busd
    was started in the background by a client. `find_fault` and `reload` are as in `busd.server.requests`.
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
        self.limits: Limits = broker.settings.limits
        self.is_background = idle_s is not None
        self.began_ns = monotonic_ns()
        self._loop = asyncio.get_running_loop()
        self.stopped: asyncio.Future[str] = self._loop.create_future()
        self._listener = listener
        self._broker = broker
        self._connections: set[PeerConnection] = set()
        self._peers: dict[PeerId, PeerConnection] = {}
        self._life = Life()
        self._drain: Drain | None = None
        self._alarm = Alarm(broker.timers, self._tick)
        self._effects = EffectRunner(broker.meter, self._peers, self)
        self.serving = Serving(broker, self._peers, self._connections, self._effects, self._alarm)
        self._requests = Requests(self, find_fault, reload)
        self._idle_s = idle_s
        self._idle_timer: asyncio.TimerHandle | None = None
        self._admission = Admission(listener.socket, self)
        self._watch_idle()

    # --- life

    def stop(self, reason: str) -> None:
        """Stop listening, and close the connections when all sent data has arrived; see
        busd.server.shutdown.
        """
        self._on(LifeEvent.STOP, reason)

    def stop_now(self, reason: str) -> None:
        """As `stop`; the second time without waiting for peers."""
        self._on(LifeEvent.INTERRUPT, reason)

    def restart(self, reason: str) -> None:
        """As `stop`, but clients that connect meanwhile wait for the next busd.

        That one gets the listening socket. A restart that has begun can still be turned into an end.
        """
        self._on(LifeEvent.RESTART, reason)

    @property
    def is_ending(self) -> bool:
        """Whether busd lets no process in any more."""
        return self._life.is_ending

    @property
    def is_restarting(self) -> bool:
        """Whether the end is a restart; final once `stopped` is done."""
        return self._life.is_restarting

    def _on(self, event: LifeEvent, reason: str) -> None:
        """Do what the change of state asks for, if it is one."""
        before, after = self._life.state, self._life.on(event)
        if after is before:
            return
        if before is LifeState.SERVING:
            self._begin_end(reason)
        elif after is LifeState.HURRIED:
            assert self._drain is not None
            self._drain.end()
        else:  # busd was about to restart
            self._listener.close()

    def _begin_end(self, reason: str) -> None:
        self._admission.close()
        for connection in tuple(self._connections):
            connection.end_pause()
        if not self.is_restarting:
            self._listener.close()  # first of all: clients find no busd from now on, and start one
        self._alarm.close()
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        self._drain = Drain(
            self._connections,
            f"busd {'restarts' if self.is_restarting else 'stops'}: {reason}",
            longest_s=self.limits.drain_s,
            on_poll=self.serving.check_early,  # their earlier connections end, but are not removed any more
            on_heard=self._say_farewell,
            on_end=partial(self._end, reason),
        )

    def _say_farewell(self) -> None:
        self._effects.carry_out(self._broker.farewell(monotonic_ns()))
        self._effects.flush()

    def _end(self, reason: str) -> None:
        self._life.on(LifeEvent.DRAIN)
        self.stopped.set_result(reason)

    # --- requests (RequestHost, EffectHost)

    def ask_restart(self, effect: Restart) -> None:
        self._requests.restart(effect)

    def ask_reload(self, effect: Reload) -> None:
        self._requests.reload(effect.peer, effect.request)

    def answer(self, peer: PeerId, answer: Message) -> None:
        self._effects.send(peer, answer)

    def reconfigure(self, limits: Limits, rules: tuple[TopicRule, ...], access: Access) -> None:
        """Go by these from now on."""
        self.limits = limits
        self._broker.meter.left = UNLIMITED
        for connection in self._connections:
            connection.stream.session.allow(limits.message_bytes)
        self._effects.carry_out(self._broker.reconfigure(monotonic_ns(), limits, rules, access))
        self._effects.flush()
        self._alarm.set()

    def _tick(self, now_ns: int) -> None:
        self._broker.meter.left = BUDGET  # as for a party: what is due and not done is due again at once
        self._effects.carry_out(self._broker.tick(now_ns))
        self._effects.flush()

    # --- connections that are there (PeerHost, EffectHost)

    def note_alive(self, connection: PeerConnection) -> None:
        """A peer that busd does not read now takes data: that is a sign of life."""
        self._effects.carry_out(self._broker.note_alive(monotonic_ns(), connection.id))
        self._effects.flush()

    def serve_later(self, peer: PeerId) -> None:
        self.serving.serve_later(peer)

    def lose(self, connection: PeerConnection, reason: str, *, is_cut: bool) -> None:
        if connection not in self._connections:
            return
        self._connections.discard(connection)
        level, what = (logging.WARNING, "cut off") if is_cut else (logging.DEBUG, "lost")
        pid = connection.credentials.pid
        _log.log(level, "%s pid %d: %s", what, pid, reason, extra={"peer": pid})
        if self.is_ending:
            return  # its data still goes to the others
        del self._peers[connection.id]
        self.serving.remove(connection)
        self._watch_idle()

    def disconnect(self, connection: PeerConnection) -> None:
        self.serving.has_removed(connection)
        self._connections.discard(connection)
        connection.close()
        self._watch_idle()

    # --- connections that come (AdmissionHost)

    @property
    def handshake_s(self) -> float:
        return self.limits.handshake_s

    def greeting(self) -> bytes:
        return greeting(self)

    def why_turned_away(self, who: Credentials) -> str:
        return self._broker.entrance.why_turned_away(who.uid, who.groups)

    def arrive(self, who: Credentials, said_ns: int) -> int:
        return self._broker.entrance.arrive(monotonic_ns(), who.uid, said_ns)

    def why_no_room(self, who: Credentials) -> tuple[str, bool]:
        of_user = sum(one.credentials.uid == who.uid for one in self._connections)
        return self._broker.entrance.turn_away(
            monotonic_ns(), who.uid, connections=len(self._connections) + 1, of_user=of_user + 1
        )

    def count_failed_connection(self, who: Credentials, *, for_want_of_room: bool) -> tuple[bool, int]:
        return self._broker.entrance.count_failed_connection(
            monotonic_ns(), who.uid, for_want_of_room=for_want_of_room
        )

    def let_in(self, sock: socket.socket, who: Credentials, hello: Hello) -> None:
        peer = self._broker.entrance.attach(
            monotonic_ns(), hello, pid=who.pid, uid=who.uid, gids=who.groups, process=who.process
        )
        accounts = self._broker.entrance.accounts(peer)
        party = self.serving.party(who)
        connection = self._peers[peer] = PeerConnection(self, sock, who, hello, peer, party, *accounts)
        self._connections.add(connection)
        _log.debug("%s (pid %d) connected", hello.program, who.pid, extra={"peer": who.pid})
        connection.greet()
        self._alarm.set()
        self._watch_idle()

    # --- idleness

    def _watch_idle(self) -> None:
        if self._idle_s is None or self.is_ending:
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

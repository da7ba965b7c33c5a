"""The way in: connections from their accept to their Hello, until their user's turn comes and they are let
in.

Owns the readiness of the listening socket, and the connections that are not let in yet. For such a connection
busd holds the descriptor, and bytes only while a part of its Hello is missing. It has one of a fixed number
of places (`busd.core.anteroom`), never one of a peer. All such connections together may take a part of the
processor's time; above that, new ones wait in the backlog. So a storm of connections leaves the rest of the
time to peers. Must not know messages after Hello, nor the permissions of users.
"""

import asyncio
import errno
import logging
import select
import socket
from contextlib import suppress
from time import monotonic_ns, thread_time_ns
from typing import Protocol

from bus.errors import RemoteProtocolError
from bus.wire.greeting import Greeting
from bus.wire.messages import Fault, Hello, encode_frame
from busd.core.anteroom import Anteroom
from busd.core.rate_limit import TokenBucket
from busd.server.credentials import Credentials, peer_credentials
from busd.server.strangers import strangers

__all__ = ["Admission", "AdmissionHost"]

_log = logging.getLogger("busd")

_AT_ONCE = 16
"""Connections that are accepted, or read, before the loop serves the others again."""
_SHARE_US_PER_S = 250_000
"""How much of each second newcomers may take, and how much of that at once."""
_BURST_US = 10_000
_RETRY_S = 0.5
_LOG_AGAIN_NS = 1_000_000_000
_NO_PLACE = "busd has no place left for another waiting connection; try again"
_HELD = select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR
_MOST_TURNED_AWAY = 1024
"""Users that were turned away and that the log has named."""


class AdmissionHost(Protocol):
    """Questions of admission to the server."""

    @property
    def handshake_s(self) -> float: ...

    def greeting(self) -> bytes:
        """The frame of busd's own Hello."""

    def why_turned_away(self, who: Credentials) -> str:
        """Why that user may not connect at all; "" if it may."""

    def arrive(self, who: Credentials, said_ns: int) -> int:
        """How many ns a connection that said Hello at `said_ns` must wait; 0: it may come in, and is
        counted."""

    def why_no_room(self, who: Credentials) -> tuple[str, bool]:
        """Why there is no room for another peer ("": there is), and whether the log has said so."""

    def count_failed_connection(self, who: Credentials, *, for_want_of_room: bool) -> tuple[bool, int]:
        """Whether to log it, and how many before it were not logged."""

    def let_in(self, sock: socket.socket, who: Credentials, hello: Hello) -> None:
        """Take over a connection: non-blocking, and read up to the end of its Hello."""


class _Newcomer:
    """`number` is its descriptor's number while busd looks at it (epoll), else -1."""

    __slots__ = ("greeting", "hello", "number", "sock", "who")

    def __init__(self, sock: socket.socket, who: Credentials) -> None:
        self.sock = sock
        self.who = who
        self.number = -1
        self.greeting = Greeting()
        self.hello: Hello | None = None

    def listen(self) -> bool:
        """Read the received part of its Hello; False if it has closed. Raises RemoteProtocolError."""
        try:
            while self.hello is None:
                more = strangers.receive(self.sock, self.greeting.wanted)
                if not more:
                    return False
                self.hello = self.greeting.received(more)
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            return False
        return True

    def close(self) -> None:
        """busd reads the rest of its data: the data may have brought descriptors. If something unread were
        left, the other side's libuv would perhaps not see the end.
        """
        strangers.finish(self.sock)


class Admission:
    """Lets in connections to `listening` until `close`, which leaves that open."""

    def __init__(self, listening: socket.socket, host: AdmissionHost) -> None:
        self._listening = listening
        self._host = host
        self._loop = asyncio.get_running_loop()
        self._anteroom: Anteroom[_Newcomer] = Anteroom()
        self._by_number: dict[int, _Newcomer] = {}
        # A separate epoll: cheaper for connections that come and go, and it reports an end without a read.
        self._epoll = select.epoll()
        self._cost = TokenBucket(_SHARE_US_PER_S, _BURST_US)
        self._rest: asyncio.TimerHandle | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._failed_ns = -_LOG_AGAIN_NS
        self._turned_away: set[int] = set()
        self._is_closed = False
        self._resume()

    @property
    def is_empty(self) -> bool:
        """Whether no connection waits to be let in, except perhaps in the backlog."""
        return not self._anteroom

    def accept_some(self, most: int) -> int:
        """Accept connections out of the backlog, `most` of them at most; returns how many there were."""
        for count in range(most):
            try:
                sock, _ = self._listening.accept()
            except (BlockingIOError, InterruptedError):
                return count
            except ConnectionAbortedError:
                continue
            except OSError as error:
                self._fail_to_accept(error)
                return count
            self._add_newcomer(sock)
        return most

    def close(self) -> None:
        """Accept no more, and close connections that were not let in, without a message: another busd may
        serve them.

        Their clients try again, like clients in the backlog of a busd that ends.
        """
        if self._is_closed:
            return
        self._is_closed = True
        for timer in (self._rest, self._timer):
            if timer is not None:
                timer.cancel()
        if self._rest is None:
            self._stop_listening()
        self._epoll.close()
        for newcomer in self._by_number.values():
            newcomer.close()
        self._by_number.clear()

    # --- readiness

    def _resume(self) -> None:
        self._rest = None
        self._loop.add_reader(self._listening.fileno(), self._come)
        self._loop.add_reader(self._epoll.fileno(), self._on_readable)

    def _stop_listening(self) -> None:
        self._loop.remove_reader(self._listening.fileno())
        self._loop.remove_reader(self._epoll.fileno())

    def _pause(self, seconds: float) -> None:
        if self._rest is None and not self._is_closed:
            self._stop_listening()
            self._rest = self._loop.call_later(seconds, self._resume)

    def _come(self) -> None:
        began_ns = thread_time_ns()
        self.accept_some(_AT_ONCE)
        self._charge(began_ns)

    def _on_readable(self) -> None:
        began_ns = thread_time_ns()
        self._poll()
        self._charge(began_ns)

    def _charge(self, began_ns: int) -> None:
        """Charge the time that newcomers have cost, and make them wait if it was too much."""
        now_ns = monotonic_ns()
        self._cost.take(now_ns, (thread_time_ns() - began_ns) // 1000)
        if owed_ns := self._cost.owed_ns(now_ns):
            self._pause(owed_ns / 1e9)

    def _fail_to_accept(self, error: OSError) -> None:
        """Out of descriptors or memory. Peers go on; newcomers make room for newcomers."""
        now_ns = monotonic_ns()
        if now_ns - self._failed_ns >= _LOG_AGAIN_NS:
            self._failed_ns = now_ns
            _log.error("cannot accept a connection: %s", error)
        if error.errno in (errno.EMFILE, errno.ENFILE) and self._anteroom:
            self._displace()
        else:
            self._pause(_RETRY_S)

    # --- newcomers

    def _add_newcomer(self, sock: socket.socket) -> None:
        newcomer = _Newcomer(sock, peer_credentials(sock))
        who = newcomer.who
        if reason := self._host.why_turned_away(who):
            is_known = who.uid in self._turned_away
            if len(self._turned_away) < _MOST_TURNED_AWAY:
                self._turned_away.add(who.uid)
            self._refuse(newcomer, reason, is_news=not is_known)
        else:
            self._listen_to(newcomer)

    def _listen_to(self, newcomer: _Newcomer) -> None:
        """Read the received data of the connection, and act on it."""
        try:
            is_there = newcomer.listen()
        except RemoteProtocolError as error:
            self._give_up(newcomer, str(error))
            return
        now_ns = monotonic_ns()
        if not is_there:
            self._take_out(newcomer)
            newcomer.close()
        elif newcomer.hello is None:
            if newcomer.number < 0:
                self._give_place(newcomer, now_ns)
                self._wake_by(now_ns + self._handshake_ns)
        elif not self._anteroom.first_waiting(newcomer.who.uid) and self._may_come_in(
            newcomer, now_ns, now_ns
        ):
            self._take_out(newcomer)
            self._let_in(newcomer)
        elif newcomer.number >= 0 or self._give_place(newcomer, now_ns):
            self._anteroom.on_hello(now_ns, newcomer)
            self._epoll.modify(newcomer.number, _HELD)

    def _give_place(self, newcomer: _Newcomer, now_ns: int) -> bool:
        """Give it a place; returns whether it still has it. If too many come, some lose theirs."""
        newcomer.number = newcomer.sock.fileno()
        self._by_number[newcomer.number] = newcomer
        self._epoll.register(newcomer.number, select.EPOLLIN | _HELD)
        self._anteroom.enter(now_ns, newcomer, newcomer.who.uid, newcomer.who.process)
        while self._anteroom.is_overfull:
            self._displace()
        return newcomer.number >= 0

    def _displace(self) -> None:
        """Turn away the connection that is the first to lose its place, unless it says Hello just now."""
        newcomer = self._anteroom.first_to_lose()
        if newcomer.hello is not None or self._stays_silent(newcomer):
            self._give_up(newcomer, _NO_PLACE, for_want_of_room=True)

    def _stays_silent(self, newcomer: _Newcomer) -> bool:
        """Read it once more, which may let it in or end it. Returns whether it still waits without a
        Hello."""
        self._listen_to(newcomer)
        return newcomer.number >= 0 and newcomer.hello is None

    def _may_come_in(self, newcomer: _Newcomer, said_ns: int, now_ns: int) -> bool:
        """Ask for its user's turn; if the turn is later, look again then."""
        wait_ns = self._host.arrive(newcomer.who, said_ns)
        if wait_ns:
            self._wake_by(now_ns + wait_ns)
        return not wait_ns

    def _let_in(self, newcomer: _Newcomer) -> None:
        assert newcomer.hello is not None
        reason, is_known = self._host.why_no_room(newcomer.who)
        if reason:
            self._refuse(newcomer, reason, is_news=not is_known)
        else:
            newcomer.sock.setblocking(False)
            self._host.let_in(newcomer.sock, newcomer.who, newcomer.hello)

    def _poll(self) -> None:
        """Read the connections that the kernel reports."""
        for number, _ in self._epoll.poll(0, _AT_ONCE):
            newcomer = self._by_number.get(number)
            if newcomer is None:
                continue  # let in a moment ago
            if newcomer.hello is None:
                self._listen_to(newcomer)
            else:  # its end is the only news now
                self._take_out(newcomer)
                newcomer.close()

    def _take_out(self, newcomer: _Newcomer) -> None:
        """It has no place any more. To be called before its descriptor is closed or handed over."""
        if newcomer.number >= 0:
            self._epoll.unregister(newcomer.number)
            del self._by_number[newcomer.number]
            newcomer.number = -1
            self._anteroom.leave(newcomer)

    # --- connections that are turned away

    def _give_up(self, newcomer: _Newcomer, reason: str, *, for_want_of_room: bool = False) -> None:
        """Turn it away: it has sent something other than a Hello, or none in time, or there is no place for
        it.
        """
        self._take_out(newcomer)
        who = newcomer.who
        is_news, unlogged = self._host.count_failed_connection(who, for_want_of_room=for_want_of_room)
        more = f" ({unlogged} more of user {who.uid} were not logged)" if unlogged else ""
        self._refuse(newcomer, reason, is_news=is_news, again=for_want_of_room, more=more)

    def _refuse(
        self, newcomer: _Newcomer, reason: str, *, is_news: bool, again: bool = False, more: str = ""
    ) -> None:
        """Tell it why, and close. `more` is for the log alone."""
        last_words = self._host.greeting() + encode_frame(Fault(text=reason, again=again))
        with suppress(OSError):
            newcomer.sock.send(last_words, socket.MSG_DONTWAIT)
        newcomer.close()
        level = logging.WARNING if is_news else logging.DEBUG
        pid = newcomer.who.pid
        _log.log(level, "turned away pid %d: %s%s", pid, reason, more, extra={"peer": pid})

    # --- time

    @property
    def _handshake_ns(self) -> int:
        return int(self._host.handshake_s * 1e9)

    def _wake_by(self, due_ns: int) -> None:
        if self._timer is not None:
            if due_ns >= self._timer_ns:
                return
            self._timer.cancel()
        self._timer_ns = due_ns
        self._timer = self._loop.call_later(max(0, due_ns - monotonic_ns()) / 1e9, self._tick)

    def _tick(self) -> None:
        """Turn away connections that have been silent for too long, and let in connections that have their
        turn.
        """
        began_ns = thread_time_ns()
        self._timer = None
        self._poll()  # a closed connection is not let in; a Hello said by now is not too late
        now_ns = monotonic_ns()
        while (first := self._anteroom.silent()) is not None:
            newcomer, since_ns = first
            if now_ns < since_ns + self._handshake_ns:
                self._wake_by(since_ns + self._handshake_ns)
                break
            if self._stays_silent(newcomer):
                self._give_up(newcomer, f"no Hello within {self._host.handshake_s:g} s")
        for uid in self._anteroom.users_waiting():
            while (next_one := self._anteroom.first_waiting(uid)) is not None:
                newcomer, said_ns = next_one
                if not self._may_come_in(newcomer, said_ns, now_ns):
                    break
                self._take_out(newcomer)
                self._let_in(newcomer)
        self._charge(began_ns)

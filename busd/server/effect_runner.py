"""Carries out the effects of the core: messages and runs go to the sockets, in an order that peers rely on.

Owns the list of connections that are not flushed yet. Decides nothing; the server carries out effects for
busd as a whole.
"""

import logging
from collections.abc import MutableMapping
from typing import Protocol

from bus.base.ids import PeerId
from bus.transport.stream_state import WRITE_OVER
from bus.wire.messages import Message, encode_frame
from busd.core.effects import Disconnect, Effect, Flush, Later, Note, Pause, Reload, Restart, Send, Stop
from busd.core.work import Meter
from busd.server.peer import PeerConnection

__all__ = ["EffectHost", "EffectRunner"]

_log = logging.getLogger("busd")

_WRITE = 4
"""The cost of a look for data to send, in the units of busd.core.work."""


class EffectHost(Protocol):
    """The effects other than messages and runs, for the server to carry out."""

    def serve_later(self, peer: PeerId) -> None:
        """The core has begun something for that peer, present or gone."""

    def disconnect(self, connection: PeerConnection) -> None:
        """The core has forgotten the peer, which is no longer among the peers."""

    def stop(self, reason: str) -> None: ...

    def ask_restart(self, effect: Restart) -> None: ...

    def ask_reload(self, effect: Reload) -> None: ...


class EffectRunner:
    """Carries out effects for `peers`; the cost of sending is taken off `meter`."""

    def __init__(self, meter: Meter, peers: MutableMapping[PeerId, PeerConnection], host: EffectHost) -> None:
        self.dirty: set[PeerConnection] = set()
        """Connections for which something was queued since the last flush."""
        self._meter = meter
        self._peers = peers
        self._host = host

    def carry_out(self, effects: list[Effect]) -> None:
        """Carry them out in order; `flush` sends the messages that they queue."""
        overfull: list[PeerConnection] = []
        encoded, frame = None, b""  # a change of the graph is the same message for all observers
        for effect in effects:
            if effect.__class__ is Flush:  # the hot one: this is cheaper than `match`
                if connection := self._peers.get(effect.peer):
                    connection.stream.outbox.make_ready(effect.queue)
                    self.dirty.add(connection)
                continue
            match effect:
                case Send(peer, message, descriptors):
                    if connection := self._peers.get(peer):
                        if message is not encoded:
                            encoded, frame = message, encode_frame(message)
                        connection.put(frame, descriptors)
                        self.dirty.add(connection)
                        if connection.is_user_over:
                            overfull.append(connection)
                case Later(peer):
                    self._host.serve_later(peer)
                case Disconnect(peer, _):
                    if connection := self._peers.pop(peer, None):
                        self._host.disconnect(connection)
                case Pause(peer, pause_ns):
                    connection = self._peers.get(peer)
                    if connection is not None and connection.stream.writing not in WRITE_OVER:
                        connection.pause(pause_ns / 1e9)
                case Note(level, text):
                    _log.log(level, "%s", text)
                case Stop(reason):
                    self.flush()
                    self._host.stop(reason)
                case Restart():
                    self._host.ask_restart(effect)
                case Reload():
                    self._host.ask_reload(effect)
        for connection in overfull:  # only now: its end has effects, which come after these
            self._relieve(connection)

    def flush(self, last: PeerConnection | None = None) -> None:
        """Send to every peer with waiting data; last to `last`, the sender of the message just handled.

        A subscription that learns that it exists may count on every publisher knowing it by then.
        """
        dirty, meter = self.dirty, self._meter
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

    def send(self, peer: PeerId, message: Message) -> None:
        """Send `message` at once to a peer, unless that has gone."""
        self.carry_out([Send(peer, message)])
        self.flush()

    def _relieve(self, connection: PeerConnection) -> None:
        """Too many control frames wait for a user's peers: cut off the peer with most of them."""
        connection.stream.flush()
        if connection.is_user_over:
            whole = connection.account.parent
            same_user = (one for one in self._peers.values() if one.account.parent is whole)
            max(same_user, key=lambda one: one.account.used, default=connection).relieve()

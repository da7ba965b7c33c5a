"""Requests of the operator: to stop, to restart, to read the configuration again."""

from bus.errors import ConfigurationError
from bus.wire import messages as m
from busd.core.access_guard import AccessGuard
from busd.core.effects import Effect, Reload, Restart, Send, Stop
from busd.core.entities import Peer

__all__ = ["Operator"]


class Operator:
    """Has the shell carry them out, if they come from a user that no rule of access restricts.

    `uid` is the daemon's user.
    """

    def __init__(self, access_guard: AccessGuard, uid: int) -> None:
        self._access_guard = access_guard
        self._uid = uid

    def stop(self, now_ns: int, peer: Peer, message: m.StopBroker, out: list[Effect]) -> None:
        self._check(peer, "restart" if message.restart else "stop")
        reason = f"asked by {peer.describe()}"
        if message.restart:
            out.append(Restart(peer.id, message.request, reason))
        else:
            out += [Send(peer.id, m.Done(request=message.request)), Stop(reason)]

    def reload(self, now_ns: int, peer: Peer, message: m.Reload, out: list[Effect]) -> None:
        self._check(peer, "reload")
        out.append(Reload(peer.id, message.request))

    def _check(self, peer: Peer, what: str) -> None:
        if not self._access_guard.access.is_free(peer.uid):
            raise ConfigurationError(f"user {peer.uid} may not {what} the busd of user {self._uid}")

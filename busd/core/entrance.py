"""How processes come in: which may connect and when, and how the broker then knows them.

Owns the numbers of peers. Must not know the later acts of a peer, nor its end.
"""

from collections.abc import Hashable
from itertools import count

from bus.base.ids import PeerId
from bus.wire import messages as m
from bus.wire.layout import NAMESAKES, PLACES, SILENCE
from bus.wire.runs import Account
from busd.core.access import Subject
from busd.core.access_guard import AccessGuard
from busd.core.entities import Peer
from busd.core.leases import Leases
from busd.core.quotas import Quotas
from busd.core.rate_limit import TokenBucket
from busd.core.silence import Silences

__all__ = ["Entrance"]

_LONGEST_NAME = 64
"""Characters kept of a process's own name, for the log and for GetPeers."""


class Entrance:
    """Adds to `peers`. `clock_ns` is as in Hello."""

    def __init__(
        self,
        peers: dict[PeerId, Peer],
        quotas: Quotas,
        access_guard: AccessGuard,
        leases: Leases,
        silences: Silences,
        *,
        clock_ns: int,
    ) -> None:
        self._peers = peers
        self._quotas = quotas
        self._access_guard = access_guard
        self._leases = leases
        self._silences = silences
        self._clock_ns = clock_ns
        self._numbers = count(1)

    def why_turned_away(self, uid: int, gids: frozenset[int] | None) -> str:
        """Why a process of that user may not connect; "" if it may."""
        access, who = self._access_guard.access, Subject(uid, gids)
        return "" if access.may_connect(who) else access.why_turned_away(who)

    def turn_away(self, now_ns: int, uid: int, *, connections: int, of_user: int) -> tuple[str, bool]:
        """Why there is no room for one more process of a user ("": there is), and whether the log has said
        so."""
        return self._quotas.turn_away(now_ns, uid, connections=connections, of_user=of_user)

    def arrive(self, now_ns: int, uid: int, said_ns: int) -> int:
        """Whether one more process of a user, which said Hello then, may enter: 0, or how long it waits."""
        return self._quotas.arrive(now_ns, uid, said_ns)

    def count_failed_connection(self, now_ns: int, uid: int, *, for_want_of_room: bool) -> tuple[bool, int]:
        """A connection of a user ended before it was let in; see `busd.core.quotas`."""
        return self._quotas.count_failed_connection(now_ns, uid, for_want_of_room=for_want_of_room)

    def attach(
        self,
        now_ns: int,
        hello: m.Hello,
        *,
        pid: int,
        uid: int,
        gids: frozenset[int] | None = frozenset(),
        process: Hashable = None,
    ) -> PeerId:
        """A connection said Hello; `pid`, `uid` and `gids` (None: unknown) are the kernel's word.

        `process` is equal for connections of one process, and for no others. None: `pid` tells them apart.
        """
        user = self._quotas.user(now_ns, uid)
        peer = Peer(
            id=PeerId(next(self._numbers)),
            pid=pid,
            process=process or pid,
            uid=uid,
            gids=gids,
            is_guest=not self._access_guard.access.is_free(uid),
            hears_of_namesakes=NAMESAKES in hello.capabilities,
            hears_of_silence=SILENCE in hello.capabilities,
            clock_ns=hello.clock_ns - self._clock_ns,
            keeps_places=PLACES in hello.capabilities,
            user=user,
            program=_printable(hello.program),
            version=_printable(hello.release),
            last_heard_ns=now_ns,
            lease_ns=self._leases.lease_ns,
            queued=Account(0, user.queued),
            history=Account(0, user.history),
            control=Account(0, user.control),
            declarations=TokenBucket(1, 1),
            signals=TokenBucket(1, 1),
            questions=TokenBucket(1, 1),
        )
        self._quotas.enter(peer)
        self._peers[peer.id] = peer
        self._silences.watch(now_ns, peer)
        return peer.id

    def accounts(self, peer_id: PeerId) -> tuple[Account, Account]:
        """The accounts that the shell charges for a peer: control frames that wait, messages that are not
        whole."""
        peer = self._peers[peer_id]
        return peer.control, peer.user.unfinished


def _printable(name: str) -> str:
    """What a process calls itself, made safe for other users' terminals."""
    return "".join(c if c.isprintable() else "?" for c in name[:_LONGEST_NAME])

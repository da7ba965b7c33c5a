"""How much each process and each user may have: every comparison with a limit, and the text of each refusal.

Owns the users, and the totals of all processes of a user. Must not know the things that are made if there is
room. Reaching a limit raises QuotaExceeded; samples that are too many are dropped by `busd.core.overload`.
"""

import logging
from collections.abc import Callable, Collection, Sized
from typing import TypeAlias

from bus.errors import QuotaExceeded
from bus.wire import messages as m
from bus.wire.answers import RefusedForNow
from bus.wire.runs import Account
from busd.core.effects import Effect, Note, Pause
from busd.core.entities import Holder, Peer, User
from busd.core.limits import Limits
from busd.core.rate_limit import TokenBucket

__all__ = ["LOG_AGAIN_NS", "Quotas"]

LOG_AGAIN_NS = 10_000_000_000
"""A process that hits a limit again and again is logged again once it has not hit it for so long."""

_LONGEST_PAUSE_NS = 1_000_000_000
_LEASE_PART = 4
_HANDSHAKE_PART = 4
_MISHAPS = 10
"""Log lines in a burst about failed connections of a user; else one in a second."""
_QUESTIONS_PART = 2
"""At once, a process may ask the questions of one second divided by this."""
_DECLARATIONS_PER_ENDPOINT = 4
_SIGNALS_PER_DECLARATION = 10
_COMMANDS_PER_S, _COMMANDS_AT_ONCE = 1, 10
"""How often a user's processes may have busd read its configuration, stop or restart."""
_FEW = 32
"""Records of a graph, or matches, that cost as much as one declaration."""

_WITHOUT_REFUSAL = frozenset({m.DeclareType, m.DestroyNode, m.DestroyEndpoint, m.Ping})
"""Messages without an answer. They can't be refused: busd carries them out and counts them."""
_FOR_THE_GRAPH = frozenset({m.GetGraph, m.GetPeers, m.Observe})
_COUNTED = frozenset(
    {m.CreateNode, m.CreatePublisher, m.CreateSubscription, m.GetType} | _FOR_THE_GRAPH | _WITHOUT_REFUSAL
)

_COMMANDS = frozenset({m.Reload, m.StopBroker})
_TOO_MANY_COMMANDS = (
    f"too many requests to reload, stop or restart: busd accepts {_COMMANDS_AT_ONCE} at once and then "
    f"{_COMMANDS_PER_S} a second from each user; try again"
)

_Asked: TypeAlias = tuple[str, Holder | None, int, int, int]
"""Resource, holder (None: all together), how much that has, how much more it asks for, the limit."""


class Quotas:
    """Knows the limits in force, and every user that has a process here."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.users: dict[int, User] = {}

    def reconfigure(self, limits: Limits) -> None:
        """Go by these limits from now on. Things over a limit stay."""
        self.limits = limits
        for user in self.users.values():
            self._resize(user, "user")
            for peer in user.peers.values():
                self._resize(peer, "peer")

    # --- peers come and go

    def user(self, now_ns: int, uid: int) -> User:
        """The user with that number, for a process that comes."""
        user = self.users.get(uid)
        if user is None:
            for other in [one for one in self.users.values() if _is_forgettable(now_ns, one)]:
                del self.users[other.uid]
            user = self.users[uid] = User(
                uid=uid,
                queued=Account(0),
                history=Account(0),
                control=Account(0),
                unfinished=Account(0),
                declarations=TokenBucket(1, 1),
                signals=TokenBucket(1, 1),
                arrivals=TokenBucket(1, 1),
                mishaps=TokenBucket(1, _MISHAPS),
                commands=TokenBucket(_COMMANDS_PER_S, _COMMANDS_AT_ONCE),
            )
            self._resize(user, "user")
        return user

    def enter(self, peer: Peer) -> None:
        """`peer` is there, with empty accounts of its user."""
        peer.user.peers[peer.id] = peer
        self._resize(peer, "peer")

    def leave(self, peer: Peer) -> None:
        del peer.user.peers[peer.id]

    # --- permissions

    def turn_away(self, now_ns: int, uid: int, *, connections: int, of_user: int) -> tuple[str, bool]:
        """Why one more process of a user can't be let in ("": it can), and whether the log has said so.

        `connections` counts all, `of_user` that user's; both include the asking connection.
        """
        most, most_of_user = self.limits.connections, self.limits.connections_per_user
        if connections > most:
            error = QuotaExceeded("connections", used=most, limit=most)
        elif of_user > most_of_user:
            error = QuotaExceeded(f"connections of user {uid}", used=most_of_user, limit=most_of_user)
        else:
            return "", False
        user = self.user(now_ns, uid)
        user.refused += 1
        return str(error), not _is_news(now_ns, user, error.resource)

    def arrive(self, now_ns: int, uid: int, said_ns: int) -> int:
        """One more process of a user wants to come in, which said Hello at `said_ns`.

        Returns 0 if it may, and counts it; else how long to wait before asking again. So a user with an
        endless stream of processes takes little time from busd and from others. No process waits longer than
        a second, or than a part of the time for the handshake.
        """
        arrivals = self.user(now_ns, uid).arrivals
        longest_ns = min(_LONGEST_PAUSE_NS, int(self.limits.handshake_s * 1e9) // _HANDSHAKE_PART)
        wait_ns = min(arrivals.wait_ns(now_ns), said_ns + longest_ns - now_ns)
        if wait_ns > 0:
            return wait_ns
        arrivals.take(now_ns, 1)
        return 0

    def count_failed_connection(self, now_ns: int, uid: int, *, for_want_of_room: bool) -> tuple[bool, int]:
        """A connection of a user has ended before it was let in: it brought garbage, or lost its place.

        Returns whether to log it, because there were not many lately, and how many before it were not logged.
        """
        user = self.user(now_ns, uid)
        user.refused += for_want_of_room
        if not user.mishaps.has(now_ns, 1):
            user.unlogged += 1
            return False, 0
        user.mishaps.take(now_ns, 1)
        unlogged, user.unlogged = user.unlogged, 0
        return True, unlogged

    def spend(self, now_ns: int, peer: Peer, message: object, records: Sized, out: list[Effect]) -> None:
        """Count a control frame; a question about the graph counts for the records that busd goes through,
        too.

        `records` counts the records of the graph. A guest's GetType counts for the records, too: busd looks
        for an endpoint of that type that the guest may see.

        Raises QuotaExceeded if there were too many for now and the frame can be answered. Raises
        RefusedForNow for commands: their limit is no setting. busd does not read a process over its own rate
        for a while, so refusing costs no more than serving. A process that only asks waits long before that:
        the burst is for a process that declares all its entities.
        """
        kind = type(message)
        if kind not in _COUNTED:
            if kind is not m.AssertLiveliness:  # the library sends it with each sample that busd does not see
                self._count_signal(now_ns, peer, out)
            if kind in _COMMANDS and not peer.user.commands.take_if_there(now_ns, 1):
                peer.refused += 1
                peer.user.refused += 1
                raise RefusedForNow(_TOO_MANY_COMMANDS)
            return
        tokens, can_refuse = 1, kind not in _WITHOUT_REFUSAL
        if kind in _FOR_THE_GRAPH or (kind is m.GetType and peer.is_guest):
            tokens += len(records) // _FEW
        if not peer.declarations.take_if_there(now_ns, tokens):
            self._pause(now_ns, peer, self._longest_pause_ns, out)
            if can_refuse:
                raise _too_often(peer, self.limits.declarations_per_s_per_peer)
            peer.declarations.take(now_ns, tokens)
        if kind in _FOR_THE_GRAPH:
            peer.questions.take(now_ns, tokens)
            if wait_ns := peer.questions.owed_ns(now_ns):
                self._pause(now_ns, peer, min(wait_ns, self._longest_pause_ns), out)
        if kind is m.Ping:
            return  # a sign of life counts for its process alone: others of the user can't prevent it
        if not peer.user.declarations.take_if_there(now_ns, tokens):
            if can_refuse:
                raise _too_often(peer.user, self.limits.declarations_per_s_per_user)
            peer.user.declarations.take(now_ns, tokens)

    def _count_signal(self, now_ns: int, peer: Peer, out: list[Effect]) -> None:
        wait_ns = 0
        for signals in (peer.signals, peer.user.signals):
            signals.take(now_ns, 1)
            wait_ns = max(wait_ns, signals.owed_ns(now_ns))
        if wait_ns:
            self._pause(now_ns, peer, min(wait_ns, self._longest_pause_ns), out)

    def check_node(self, peer: Peer) -> None:
        """Raise QuotaExceeded if there is no room for another node."""
        limits = self.limits
        _check(
            ("nodes", peer, len(peer.nodes), 1, limits.nodes_per_peer),
            ("nodes", peer.user, peer.user.nodes, 1, limits.nodes_per_user),
        )

    def check_type(self, peer: Peer) -> None:
        """Raise QuotaExceeded if there is no room for another type."""
        limits = self.limits
        _check(
            ("types", peer, len(peer.types) + len(peer.refused_types), 1, limits.endpoints_per_peer),
            ("bytes of types", peer, peer.schema_bytes, 1, limits.control_bytes_per_peer),
            ("bytes of types", peer.user, peer.user.schema_bytes, 1, limits.control_bytes_per_user),
        )

    def check_endpoint(
        self, now_ns: int, peer: Peer, topic: str, topics: Collection[str], matches: int
    ) -> None:
        """Raise QuotaExceeded if there is no room for another endpoint on `topic`, of as many `matches`.

        `topics` are all existing topics. A match of a guest and a peer that is none counts for the guest
        alone.
        """
        limits, user = self.limits, peer.user
        asked: list[_Asked] = [
            ("endpoints", peer, len(peer.endpoints), 1, limits.endpoints_per_peer),
            ("endpoints", user, user.endpoints, 1, limits.endpoints_per_user),
        ]
        if topic not in peer.topics:
            asked.append(("topics", peer, len(peer.topics), 1, limits.topics_per_peer))
        if topic not in user.topics:
            asked.append(("topics", user, len(user.topics), 1, limits.topics_per_user))
        if topic not in topics:
            asked.append(("topics", None, len(topics), 1, limits.topics))
        asked += (
            ("matches", peer, peer.matches + matches, 0, limits.matches_per_peer),
            ("matches", user, user.matches + matches, 0, limits.matches_per_user),
        )
        _check(*asked)
        if matches >= _FEW:
            for holder in (peer, user):
                holder.declarations.take(now_ns, matches // _FEW)

    def take_descriptors(self, peer: Peer, descriptors: tuple[object, ...]) -> None:
        """Count `descriptors` for as long as anything holds them.

        Raises QuotaExceeded if there is no room for them; then they are not counted.
        """
        limits, more = self.limits, len(descriptors)
        _check(
            ("descriptors", peer, _descriptors(peer), more, limits.descriptors_per_peer),
            ("descriptors", peer.user, _descriptors(peer.user), more, limits.descriptors_per_user),
        )
        for holder in (peer, peer.user):
            holder.descriptors.update(descriptors)

    # --- what is logged and answered

    def refused(self, now_ns: int, peer: Peer, error: QuotaExceeded, out: list[Effect]) -> None:
        """A limit has refused `peer` something."""
        for holder in (peer, peer.user):
            holder.refused += 1
        if _is_news(now_ns, peer, error.resource):
            self._report(peer, error.resource, error.used, error.limit, out.append)

    def report_bytes(
        self, now_ns: int, peer: Peer, what: str, account: Account, emit: Callable[[Effect], None]
    ) -> None:
        """`account`, the process's own or its user's, is over its limit, so `peer` loses some of `what`."""
        is_own = account.parent is not None
        if _is_news(now_ns, peer, what if is_own else what + " all"):  # a full one is so with each run
            whose = _name(peer if is_own else peer.user)
            self._report(peer, f"{what} {whose}", account.used, account.limit, emit)

    def _report(
        self, peer: Peer, resource: str, used: int, limit: int, emit: Callable[[Effect], None]
    ) -> None:
        what = f"limit reached by {peer.describe()} of user {peer.uid}: {resource}: {used} of {limit}"
        emit(Note(logging.WARNING, what))

    def records(
        self, now_ns: int, only: User | None
    ) -> tuple[tuple[m.PeerRecord, ...], tuple[m.UserRecord, ...]]:
        """Records of the resources of every process and every user, or of `only` that user."""
        users = (
            [user for user in self.users.values() if user.peers or user.absent] if only is None else [only]
        )
        peers = [peer for user in users for peer in user.peers.values()]
        return tuple(_peer_record(now_ns, peer) for peer in peers), tuple(map(_user_record, users))

    def _resize(self, holder: Holder, whose: str) -> None:
        def limit(name: str) -> int:
            value: int = getattr(self.limits, f"{name}_per_{whose}")
            return value

        holder.queued.limit = limit("queued_bytes")
        holder.history.limit = limit("history_bytes")
        holder.control.limit = limit("control_bytes")
        # A process declares everything at once to a new busd. A program may make everything that its limits
        # allow at once.
        rate = limit("declarations_per_s")
        burst = rate + limit("nodes") + limit("matches") // _FEW
        holder.declarations.resize(rate, burst + _DECLARATIONS_PER_ENDPOINT * limit("endpoints"))
        # A new match of each endpoint may be attached, acknowledged and reported at once.
        signals = _SIGNALS_PER_DECLARATION * rate
        holder.signals.resize(signals, signals + limit("matches"))
        if isinstance(holder, User):
            holder.unfinished.limit = limit("queued_bytes")
            most = self.limits.connections_per_user
            holder.arrivals.resize(most, most)
        elif isinstance(holder, Peer):
            holder.questions.resize(rate, max(rate // _QUESTIONS_PART, 1))

    @property
    def _longest_pause_ns(self) -> int:
        return min(_LONGEST_PAUSE_NS, int(self.limits.lease_s * 1e9) // _LEASE_PART)

    def _pause(self, now_ns: int, peer: Peer, pause_ns: int, out: list[Effect]) -> None:
        if now_ns + pause_ns > peer.paused_ns:
            peer.paused_ns = now_ns + pause_ns
            out.append(Pause(peer.id, pause_ns))


def _is_news(now_ns: int, holder: Holder, resource: str) -> bool:
    """Whether to log that `holder` is at that limit: the first time, and again after a while below it."""
    last_ns = holder.hit_ns.get(resource)
    holder.hit_ns[resource] = now_ns
    return last_ns is None or now_ns - last_ns >= LOG_AGAIN_NS


def _check(*asked: _Asked) -> None:
    """Raise QuotaExceeded for the first resource without room."""
    for resource, holder, used, more, limit in asked:
        if used + more > limit:
            whose = "" if holder is None else f" of {_name(holder)}"
            raise QuotaExceeded(resource + whose, used=used, limit=limit)


def _too_often(holder: Holder, limit: int) -> QuotaExceeded:
    return QuotaExceeded(f"declarations per second of {_name(holder)}", used=limit, limit=limit)


def _name(holder: Holder) -> str:
    return f"user {holder.uid}" if isinstance(holder, User) else "a process"


def _descriptors(holder: Holder) -> int:
    """The number of descriptors that busd holds of it. Descriptors of connections belong to the kernel and
    the shell, but count as well.
    """
    return len(holder.descriptors) + (len(holder.peers) if isinstance(holder, User) else 1)


def _is_forgettable(now_ns: int, user: User) -> bool:
    buckets = user.declarations, user.arrivals, user.mishaps, user.commands
    is_rested = all(bucket.is_full(now_ns) for bucket in buckets)
    return is_rested and not user.peers and not user.descriptors and not user.absent


def _peer_record(now_ns: int, peer: Peer) -> m.PeerRecord:
    return m.PeerRecord(
        id=peer.id,
        pid=peer.pid,
        uid=peer.uid,
        program=peer.program,
        version=peer.version,
        nodes=len(peer.nodes),
        endpoints=len(peer.endpoints),
        topics=len(peer.topics),
        matches=peer.matches,
        descriptors=_descriptors(peer),
        queued_bytes=peer.queued.used,
        history_bytes=peer.history.used,
        control_bytes=peer.control.used,
        refused=peer.refused,
        silent_s=max(0, now_ns - peer.last_heard_ns) / 1e9,
    )


def _user_record(user: User) -> m.UserRecord:
    return m.UserRecord(
        uid=user.uid,
        connections=len(user.peers),
        endpoints=user.endpoints,
        topics=len(user.topics),
        descriptors=_descriptors(user),
        queued_bytes=user.queued.used,
        history_bytes=user.history.used,
        refused=user.refused,
        absent=user.absent,
    )

"""Checks requests of peers against the rules of access, and reports denials.

Owns the list of denials that were reported already. Must not know how the rules are matched
(busd.core.access), nor what an observer sees (busd.core.graph_view).
"""

import logging
from collections.abc import Callable, Generator
from hashlib import blake2b

from bus.base.ids import PeerId
from bus.errors import AccessDenied
from bus.wire.layout import ACCESS
from bus.wire.messages import Incompatible
from busd.core.access import Access, Action
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Node, Peer, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.work import RULES_PER_UNIT, TELL, Work

_MOST_REPORTED = 1024
"""Denials of one user that are reported; with more it could crowd other users out of the log."""


class AccessGuard:
    """`access` are the rules in force; `renew` replaces them. `begin` starts work that is done in a peer's
    turns.
    """

    def __init__(self, graph: Graph, access: Access, begin: Callable[[PeerId, Work], None]) -> None:
        self.access = access
        self._graph = graph
        self._begin = begin
        self._reported: dict[int, set[tuple[Action, str]]] = {}

    def renew(self, access: Access) -> None:
        """Apply other rules from now on; report their denials again."""
        self.access = access
        self._reported.clear()

    def admit(self, node: Node, action: Action, topic: str, out: list[Effect]) -> None:
        """Raises AccessDenied if the user of `node` may not do that.

        The first time, the log reports it, and so does busd to the other ends on the topic, which may wait
        for it.
        """
        if not node.peer.is_guest:
            return
        who = node.peer.subject
        if not self.access.decide(who, action, topic).is_allowed:
            text = self.access.why_not(who, action, topic)
            reported = self._reported.setdefault(who.uid, set())
            if (action, topic) not in reported and len(reported) < _MOST_REPORTED:
                reported.add((action, topic))
                more = (
                    f"; no more denials of user {who.uid} are logged"
                    if len(reported) == _MOST_REPORTED
                    else ""
                )
                self._report(node, action, topic, text, more, out)
            raise AccessDenied(text)

    def gid(self, peer: Peer, gid: bytes) -> bytes:
        """The gid that others see of an endpoint that calls itself `gid`.

        Subscriptions know their publishers again by gid, and a guest can read the gids of others. So busd
        mixes the gid that a guest claims with its uid: it can't be another user's, and is the same at each
        busd.
        """
        if not peer.is_guest:
            return gid
        return blake2b(gid, digest_size=len(gid), salt=peer.uid.to_bytes(16, "little")).digest()

    def price(self, looks: int) -> int:
        """Price of the questions asked since `access.looks` had that value."""
        return max(0, self.access.looks - looks) // RULES_PER_UNIT

    def may_observe(self, peer: Peer, topic: str) -> bool:
        return self.access.decide(peer.subject, "observe", topic).is_allowed

    def find_fault(self, peer: Peer) -> Generator[int, int, str]:
        """Something that `peer` has and its user may not have any more; "" if there is nothing. Work."""
        who = peer.subject
        if not self.access.may_connect(who):
            return f"{self.access.name(who.uid)} may not use this busd: its access rules have changed"
        for endpoint in tuple(peer.endpoints.values()):
            action, looks = action_of(endpoint), self.access.looks
            if not self.access.decide(who, action, endpoint.topic.name).is_allowed:
                return (
                    f"{self.access.why_not(who, action, endpoint.topic.name)} (the access rules have changed)"
                )
            yield TELL + self.price(looks)
        return ""

    def _report(
        self, node: Node, action: Action, topic: str, text: str, more: str, out: list[Effect]
    ) -> None:
        out.append(Note(logging.WARNING, f"{node.full_name} of {node.peer.describe()}: {text}{more}"))
        present = self._graph.topics.get(topic)
        if present is None:
            return
        others = (present.subscriptions if action == "publish" else present.publishers).values()
        self._begin(node.peer.id, _report(node, topic, text, tuple(others), out))


def _report(
    node: Node, topic: str, text: str, others: tuple[Publisher | Subscription, ...], out: list[Effect]
) -> Work:
    """Tell the other ends on a topic that `node` was denied it."""
    for other in others:
        message = Incompatible(endpoint=other.id, topic=topic, node=node.full_name, policy=ACCESS, text=text)
        out.append(Send(other.node.peer.id, message))
        yield TELL


def action_of(endpoint: Publisher | Subscription) -> Action:
    """The action that such an endpoint is for."""
    return "publish" if isinstance(endpoint, Publisher) else "subscribe"

"""Settings that the operator can change while busd runs: limits, topic rules and access. Applies new values.

Must not know their source.
"""

from collections.abc import Callable, Collection

from busd.core.access import Access
from busd.core.access_guard import AccessGuard
from busd.core.effects import Effect
from busd.core.entities import Peer
from busd.core.leases import Leases
from busd.core.limits import Limits, TopicRule
from busd.core.overload import Overload
from busd.core.queries import Queries
from busd.core.quotas import Quotas
from busd.core.registry import Registry
from busd.core.router import Router
from busd.core.tasks import Tasks
from busd.core.work import Work


class AccessReview:
    """Checks the present endpoints and views of peers after a change of the access rules.

    `cut` ends the connection of a peer, for a reason; effects go to `out`.
    """

    def __init__(
        self,
        guard: AccessGuard,
        queries: Queries,
        out: list[Effect],
        tasks: Tasks,
        cut: Callable[[int, Peer, str], None],
    ) -> None:
        self.guard = guard
        self._queries = queries
        self._out = out
        self._tasks = tasks
        self._cut = cut

    def change(self, access: Access, peers: Collection[Peer]) -> None:
        """New rules: each guest is checked against them in its own turns, before its other waiting tasks."""
        if access.rules == self.guard.access.rules:  # a change asks for each endpoint of each guest
            return
        self.guard.renew(access)
        for peer in peers:
            if not access.is_free(peer.uid):
                self._tasks.begin(peer.id, self._review(peer), is_first=True)

    def _review(self, peer: Peer) -> Work:
        """Cut off a peer that has something that the rules deny. When it is back, busd refuses that."""
        fault = yield from self.guard.find_fault(peer)
        if fault:
            now_ns = yield 0
            self._cut(now_ns, peer, fault)
        else:
            yield from self._queries.renew(peer, self._out)


class Settings:
    """The limits of the broker, and whatever follows them and other settings."""

    def __init__(
        self,
        limits: Limits,
        quotas: Quotas,
        leases: Leases,
        router: Router,
        overload: Overload,
        registry: Registry,
        access: AccessReview,
    ) -> None:
        self.limits = limits
        self._quotas = quotas
        self._leases = leases
        self._router = router
        self._overload = overload
        self._registry = registry
        self.access = access

    def change(
        self,
        now_ns: int,
        limits: Limits,
        rules: tuple[TopicRule, ...],
        access: Access,
        peers: Collection[Peer],
    ) -> None:
        """Apply these from now on; `peers` are connected."""
        self.limits = limits
        self._quotas.reconfigure(limits)
        self._registry.rules = rules
        self._leases.lease_ns = int(limits.lease_s * 1e9)
        self._router.reconfigure(
            window_bytes=limits.keep_all_window_bytes,
            window_samples=limits.keep_all_window_messages,
        )
        self._overload.bound_all(now_ns, peers)
        self.access.change(access, peers)

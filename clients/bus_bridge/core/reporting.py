"""Reports about a bridge's routes: in the graph, as counters of mirrors, and as its status."""

from bus.vocabulary import DropReason
from bus_bridge.core.exports import Exports
from bus_bridge.core.mirrors import EndpointMirror, Mirrors
from bus_bridge.core.status import GetStatus, LinkState, MirrorCounts, RouteState
from bus_bridge.engine import Engine

__all__ = ["Reporting"]

_STUCK_S = 3.0


class Reporting:
    """Reports about the routes of `exports` and `mirrors`."""

    def __init__(self, exports: Exports, mirrors: Mirrors) -> None:
        self._exports = exports
        self._mirrors = mirrors
        self._reported: dict[EndpointMirror, object] = {}
        self._progress: dict[object, tuple[int, float]] = {}
        """Routes with waiting messages: their number of sent messages, and the time since which it has not
        changed."""
        self._now_s = 0.0

    def report(self, now_s: float) -> None:
        """Report changes to the graph. Call this each second."""
        self._now_s = now_s
        self._reported = {mirror: self._report(mirror) for mirror in self._mirrors}
        waiting: dict[object, tuple[int, float]] = {}
        for _, export in self._exports:
            if export.waiting and export.is_flowing:
                waiting[export] = self._since(export, export.account.sent)
        for mirror in self._mirrors:
            if mirror.way is not None and mirror.way.waiting:
                waiting[mirror.way] = self._since(mirror.way, mirror.way.account.sent)
        self._progress = waiting

    def _since(self, way: object, sent: int) -> tuple[int, float]:
        known = self._progress.get(way)
        return known if known is not None and known[0] == sent else (sent, self._now_s)

    def _is_stuck(self, way: object) -> bool:
        known = self._progress.get(way)
        return known is not None and self._now_s - known[1] >= _STUCK_S

    def _report(self, mirror: EndpointMirror) -> object:
        """Report one mirror; returns the reported values."""
        known = self._reported.get(mirror)
        if mirror.subscription is not None and mirror.route is not None:
            crossed = mirror.route.sent - mirror.sent_before
            if crossed and known != crossed:
                mirror.subscription.report_besides(samples=crossed)
            return crossed
        if mirror.publisher is not None and mirror.way is not None:
            losses = mirror.way.losses
            if losses and known != losses:
                mirror.publisher.report_besides(dropped=losses)
            return losses
        return None

    def status(
        self,
        *,
        engine: Engine,
        bus: str,
        namespace: str,
        uptime_s: float,
        buses: list[str],
        shown_there: tuple[int, int, int],
    ) -> GetStatus.Response:
        refused, refusal = engine.refusals()
        routes = [*self._ways_out(), *self._ways_in(has_numbers=engine.has_numbers)]
        routes.sort(key=lambda one: (one.topic, one.direction, one.node))
        return GetStatus.Response(
            engine=engine.name,
            bus=bus,
            namespace=namespace,
            uptime_s=uptime_s,
            links=[
                LinkState(address=one.address, state=one.state, bus=one.bus, text=one.text)
                for one in engine.links()
            ],
            refused=refused,
            refusal=refusal,
            buses=buses,
            shown_here=_counts(self._mirrors.counts),
            shown_there=_counts(shown_there),
            repeated=sum(one.dropped.get(DropReason.REPEATED, 0) for one in routes),
            routes=routes,
        )

    def _ways_out(self) -> list[RouteState]:
        found = []
        for route, export in self._exports:
            shown = self._exports.shown.get(export)
            account = export.account
            found.append(
                RouteState(
                    topic=route.topic.name,
                    type_name=route.topic.type_name,
                    direction="out",
                    node="" if shown is None else shown.node,
                    gid=export.gid.hex(),
                    is_flowing=export.is_flowing and bool(route.taps),
                    is_stuck=self._is_stuck(export),
                    taken=account.taken,
                    sent=export.sent,
                    bytes=account.bytes,
                    waiting=export.waiting,
                    dropped=export.losses,
                )
            )
        return found

    def _ways_in(self, *, has_numbers: bool) -> list[RouteState]:
        found = []
        for mirror in self._mirrors:
            way, far = mirror.way, mirror.far
            if way is None:
                continue
            found.append(
                RouteState(
                    topic=far.topic,
                    type_name=far.far.type_name,
                    direction="in",
                    node=f"{far.node.namespace.rstrip('/')}/{far.node.name}",
                    bus=far.node.bus,
                    gid=far.far.gid.hex(),
                    is_flowing=way.is_flowing,
                    is_stuck=self._is_stuck(way),
                    taken=way.taken,
                    sent=way.account.sent,
                    bytes=way.account.bytes,
                    waiting=way.waiting,
                    counts_lost=has_numbers,
                    dropped=way.losses,
                )
            )
        return found


def _counts(shown: tuple[int, int, int]) -> MirrorCounts:
    nodes, publishers, subscriptions = shown
    return MirrorCounts(nodes=nodes, publishers=publishers, subscriptions=subscriptions)

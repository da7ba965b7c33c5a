"""All routes out: the taps for far subscriptions, and the route for each publisher's messages.

A topic and type have taps while a far subscription is shown here. Owns the taps; makes no mirrors.
"""

import asyncio
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import msgspec

from bus.endpoint.matches import Match
from bus.events import SubscriptionEvents
from bus.node import Node
from bus.qos import Durability, History, QoSProfile, Reliability
from bus.schema import MessageSchema, depth_for
from bus.subscription import Subscription
from bus_bridge.batch import Batch
from bus_bridge.core.export import PATIENCE_S, Export
from bus_bridge.core.local_graph import Shown
from bus_bridge.core.rules import Rules
from bus_bridge.core.taps import Taps
from bus_bridge.engine import RouteRule, Writer
from bus_bridge.errors import in_words

__all__ = ["Exports", "TopicExports", "TypedTopic"]


_BATCH = 256
_SHORT_S = 0.4
"""After this time messages are sent without a graph: the publisher left before a graph showed it."""
_EARLY_S = 5.0
"""Time for which messages wait for a graph that shows their publisher."""
_LINGER_S = 2.0
"""Time for which messages wait after their publisher has gone."""
_LOOK_S = 0.02
_MOST_REMEMBERED = 1000
_new_sample: Any = tuple.__new__


class TypedTopic(NamedTuple):
    """A topic of this bus, and a type."""

    name: str
    type_name: str
    type_hash: str


class TopicExports:
    """The routes out of one topic and type."""

    def __init__(
        self,
        topic: TypedTopic,
        schema: MessageSchema,
        depth: int,
        knows: Callable[[bytes], bool],
        hides: Callable[[bytes], bool],
        on_trouble: Callable[[str], object],
        unsure: "set[TopicExports]",
        *,
        is_local: bool,
    ) -> None:
        self.topic = topic
        self.schema = schema
        self.is_local = is_local
        """Whether only publishers of this bus go out, and no publishers mirrored by other bridges."""
        self.exports: dict[bytes, Export] = {}
        """Routes by the publisher's gid."""
        self.mirrors: dict[Subscription[Any], None] = {}
        """The far subscriptions, as their mirrors on this bus."""
        self.away: dict[bytes, None] = {}
        """Far subscriptions that have gone. A subscription that comes back was disconnected, and has missed
        messages."""
        self.holders = 0
        """Number of far subscriptions that need the taps."""
        self.taps = Taps(self._put)
        self.depth = depth
        self.early: dict[bytes, float] = {}
        """Publishers with messages before a graph showed them, and the time of the first message."""
        self.met: dict[bytes, Match] = {}
        """Publishers that no graph has shown yet, as described by their match with a tap."""
        self._knows = knows
        self._hides = hides
        self._on_trouble = on_trouble
        self._unsure = unsure
        """Routes that `sweep` must check. A route is in it while `early` or `met` is not empty, or while a
        publisher is held back."""
        self._matched: frozenset[bytes] | None = None
        self._present: frozenset[bytes] = frozenset()
        self._sent_by_gone = 0

    def is_matched(self, gid: bytes) -> bool:
        """Whether a far subscription is matched with this publisher, or may have been before the publisher
        left."""
        if self._matched is None:
            self._matched = frozenset(match.gid for one in self.mirrors for match in one.matches)
            self._present = frozenset(match.gid for tap in self.taps for match in tap.matches)
        if gid in self._matched or self.holders > len(self.mirrors):  # a new mirror may be matched already
            return True
        return bool(self.mirrors) and gid not in self._present

    def on_matched(self, tap: Subscription[Any] | None) -> None:
        """Update the publishers: some of this bus may have come or gone."""
        self._matched = None
        for match in () if tap is None or not self.is_local else tap.matches:
            if match.gid not in self.exports and not self._knows(match.gid):
                self.met[match.gid] = match
                self._unsure.add(self)
        while len(self.met) > _MOST_REMEMBERED:
            del self.met[next(iter(self.met))]

    def matches_changed(self) -> None:
        self._matched = None
        for export in tuple(self.exports.values()):
            export.flush()

    @property
    def sent(self) -> int:
        """Number of sent messages."""
        return self._sent_by_gone + sum(one.account.sent for one in self.exports.values())

    def export(self, gid: bytes, *, is_lossless: bool = False) -> Export:
        """The route of a publisher; makes it at the first call."""
        found = self.exports.get(gid)
        if found is None:
            found = self.exports[gid] = Export(
                gid, self.depth, self.is_matched, self.taps.release, is_lossless=is_lossless
            )
        return found

    def forget(self, export: Export) -> None:
        if self.exports.get(export.gid) is export:
            del self.exports[export.gid]
            self._sent_by_gone += export.account.sent
        self.early.pop(export.gid, None)

    def begin(self, *, is_back: bool) -> None:
        """Start with new taps. `is_back`: a far subscription has received messages from earlier taps."""
        for export in self.exports.values():
            export.begin(is_back=is_back)
        self.met = {gid: match for gid, match in self.met.items() if not self._knows(gid)}
        self.taps.begin()

    def _put(self, tap: Subscription[Any], gid: bytes, batch: Batch) -> None:
        export = self.exports.get(gid) or self._early(gid, is_lossless=tap.qos.is_lossless)
        if export is not None:
            try:
                export.put(batch)
            except Exception as error:  # an error in one route must not end the others
                self._on_trouble(f"'{self.topic.name}': {in_words(error)}")
            if export.is_lossless and export.is_full and gid not in self.taps.full:
                self.taps.hold_back(gid)
                self._unsure.add(self)

    def _early(self, gid: bytes, *, is_lossless: bool) -> Export | None:
        if self._hides(gid):  # an unknown publisher is not hidden: a graph may show it soon
            return None
        self.early[gid] = asyncio.get_running_loop().time()
        self._unsure.add(self)
        return self.export(gid, is_lossless=is_lossless)


class Exports:
    """Makes routes and taps. `node` belongs to the bridge.

    `knows` returns whether the last graph had a publisher. `hides` returns whether it had a publisher that
    the far side must not see.
    """

    def __init__(
        self,
        node: Node,
        rules: Rules,
        knows: Callable[[bytes], bool],
        hides: Callable[[bytes], bool],
        on_trouble: Callable[[str], object],
    ) -> None:
        self._node = node
        self._rules = rules
        self._knows = knows
        self._hides = hides
        self._on_trouble = on_trouble
        self._routes: dict[TypedTopic, TopicExports] = {}
        self._unsure: set[TopicExports] = set()
        """The routes that `sweep` must check; other routes cost no time."""
        self._of_gid: dict[bytes, tuple[TopicExports, Export]] = {}
        self._leaving: dict[Export, tuple[asyncio.TimerHandle, Callable[[], object]]] = {}
        """Routes with waiting messages after their publisher has gone: the timer of the next check, and the
        function to call at the end."""
        self._loop = asyncio.get_running_loop()
        self.on_short: Callable[[TopicExports, Match], object] = lambda route, match: None
        """Called for a publisher that left before a graph showed it."""
        self.shown: dict[Export, Shown] = {}
        """The endpoints that the far side can see."""

    def __iter__(self) -> Iterator[tuple[TopicExports, Export]]:
        for route in self._routes.values():
            for export in route.exports.values():
                yield route, export

    def route(self, topic: TypedTopic, schema: MessageSchema) -> TopicExports:
        found = self._routes.get(topic)
        if found is None:
            rule = self._rules.crossing(topic.name).rule
            depth = rule.depth or depth_for(schema)
            found = self._routes[topic] = TopicExports(
                topic,
                schema,
                depth,
                self._knows,
                self._hides,
                self._on_trouble,
                self._unsure,
                is_local=not rule.transit,
            )
        return found

    def reconfigure(self, rules: Rules) -> None:
        """Use other rules, for publishers and far subscriptions that come from now on."""
        self._rules = rules
        for route in self._routes.values():
            rule = rules.crossing(route.topic.name).rule
            route.depth = rule.depth or depth_for(route.schema)
            route.is_local = not rule.transit

    def schema(self, topic: TypedTopic) -> MessageSchema | None:
        """The schema of a topic and type; None if no far subscription has them."""
        found = self._routes.get(topic)
        return None if found is None else found.schema

    # --- publishers of this bus

    def prepare(self, topic: TypedTopic, schema: MessageSchema, shown: Shown) -> tuple[Export, RouteRule]:
        """Return the route and the rule of a publisher before the far side sees it."""
        gid, route = shown.local.gid, self.route(topic, schema)
        export = route.export(gid)
        if (leaving := self._leaving.pop(export, None)) is not None:  # it is back: send its waiting messages
            timer, on_closed = leaving
            timer.cancel()
            export.detach()
            on_closed()
        self._of_gid[gid] = route, export
        self.shown[export] = shown
        return export, msgspec.structs.replace(shown.rule, depth=route.depth)

    def attach(self, export: Export, writer: Writer, qos: QoSProfile, rule: RouteRule) -> None:
        route, _ = self._of_gid[export.gid]
        route.early.pop(export.gid, None)
        export.attach(writer, qos, rule)

    def discard(self, gid: bytes) -> None:
        """Close the route of a publisher that the engine can't carry."""
        self._end(*self._of_gid.pop(gid))

    def withdraw(self, gid: bytes, on_closed: Callable[[], object], *, is_excluded: bool = False) -> None:
        """End the route of a publisher that has gone. Its waiting messages are still sent if that is possible
        soon; then `on_closed` is called. `is_excluded`: the rules no longer let it cross, so it ends at
        once."""
        known = self._of_gid.pop(gid, None)
        if known is None:
            on_closed()
            return
        route, export = known
        if is_excluded:
            if export.waiting:
                self._on_trouble(
                    f"'{route.topic.name}' no longer crosses, by the rules (messages lost: {export.waiting})"
                )
            self._end(route, export)
            on_closed()
            return

        sent, end_s = export.account.sent, self._loop.time() + _LINGER_S

        def check() -> None:
            nonlocal sent, end_s
            if export.account.sent != sent:  # it still makes progress, however slow
                sent, end_s = export.account.sent, self._loop.time() + _LINGER_S
            if (export.waiting or route.taps.has_news) and self._loop.time() < end_s:
                self._leaving[export] = self._loop.call_later(_LOOK_S, check), on_closed
                return
            if export.waiting:
                self._on_trouble(
                    f"'{route.topic.name}': a publisher has left, and the far side did not take all of its "
                    f"messages (messages lost: {export.waiting})"
                )
            self._leaving.pop(export, None)
            self._end(route, export)
            on_closed()

        check()

    # --- far subscriptions on this bus

    async def hold(self, topic: TypedTopic, schema: MessageSchema, gid: bytes) -> TopicExports:
        """Make sure that a topic and type have taps, for one more far subscription. Raises BusError."""
        route = self.route(topic, schema)
        route.holders += 1
        try:
            async with route.taps.opening:
                if not route.taps:
                    await self._open_taps(route, is_back=gid in route.away)
        except BaseException:
            route.holders -= 1
            self._drop_unused(route)
            raise
        route.away.pop(gid, None)
        return route

    async def release(self, route: TopicExports, gid: bytes) -> None:
        """Release the taps of a far subscription. Cancellation: they are closed, or this subscription no
        longer counts."""
        route.holders -= 1
        route.away[gid] = None
        while len(route.away) > _MOST_REMEMBERED:
            del route.away[next(iter(route.away))]
        try:
            async with route.taps.opening:
                if not route.holders:
                    await asyncio.gather(*(tap.close() for tap in route.taps.replace([])))
        finally:
            route.matches_changed()
            self._drop_unused(route)

    async def _open_taps(self, route: TopicExports, *, is_back: bool) -> None:
        profiles = (
            QoSProfile(
                route.depth, reliability=Reliability.BEST_EFFORT, durability=Durability.BEST_AVAILABLE
            ),
            QoSProfile(history=History.KEEP_ALL, durability=Durability.BEST_AVAILABLE),
        )
        taps: list[Subscription[Any]] = []
        try:
            for profile in profiles:
                taps.append(await self._open_tap(route, profile))
        except BaseException:
            for tap in taps:
                await tap.close()
            raise
        route.taps.replace(taps)
        route.begin(is_back=is_back)

    async def _open_tap(self, route: TopicExports, profile: QoSProfile) -> Subscription[Any]:
        tap: Subscription[Any] | None = None
        tap = await self._node.create_subscription(
            route.schema,
            route.topic.name,
            profile,
            events=SubscriptionEvents(matched=lambda change: route.on_matched(tap)),
            raw=True,
            local_only=route.is_local,
            role="tap",
        )
        route.on_matched(tap)
        return tap

    # --- regular checks

    def sweep(self) -> None:
        """Check publishers that no graph has shown, and lossless publishers without a reading far
        subscription."""
        now_s = self._loop.time()
        for route in tuple(self._unsure):
            for gid in [gid for gid in route.met if self._knows(gid)]:
                del route.met[gid]
            for gid, since_s in tuple(route.early.items()):
                if now_s - since_s > _EARLY_S:
                    self._end(route, route.exports[gid])
                elif now_s - since_s > _SHORT_S and (match := route.met.pop(gid, None)) is not None:
                    self.on_short(route, match)
            for export in tuple(route.exports.values()):
                if export.has_timed_out(now_s):
                    self._on_trouble(
                        f"'{route.topic.name}': a lossless publisher waited {PATIENCE_S:g} s for a matched "
                        "subscription on the other side, which does not read: the bridge drops its messages "
                        "until the other side reads again"
                    )
            self._drop_unused(route)
            if (
                not (route.met or route.early or route.taps.full)
                or self._routes.get(route.topic) is not route
            ):
                self._unsure.discard(route)

    def close(self) -> None:
        """Close all; waiting messages are lost."""
        for timer, _ in self._leaving.values():
            timer.cancel()
        for route in self._routes.values():
            route.taps.replace([])
            for export in route.exports.values():
                export.close()
        self._routes.clear()

    def _end(self, route: TopicExports, export: Export) -> None:
        self.shown.pop(export, None)
        export.close()
        route.forget(export)
        self._drop_unused(route)

    def _drop_unused(self, route: TopicExports) -> None:
        is_unused = not route.exports and not route.holders
        if is_unused and self._routes.get(route.topic) is route:  # else a later one has its place
            del self._routes[route.topic]

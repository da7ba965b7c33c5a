"""What pages look at: one subscription for each topic, however many look, as long as one does.

Best effort, with room for five: who looks holds nobody up. Messages come encoded; who wants values decodes
those it shows.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Protocol

from bus.errors import BusError
from bus.graph import Graph
from bus.node import Node
from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema, support_of
from bus.subscription import MessageInfo, Subscription

__all__ = ["Heard", "Listener", "Taps"]

_DEPTHS = {"/rosout": 200}
"""Of a log, its last lines are of interest."""
_DEPTH = 5
_MOST_AT_ONCE = 200


class Heard:
    """A message of a topic; decoded when the first asks, for all that ask."""

    __slots__ = ("_decode", "_message", "frames", "info", "number", "payload", "schema", "type_name")

    def __init__(
        self,
        schema: MessageSchema,
        decode: Callable[[Any], Any],
        payload: bytes,
        info: MessageInfo,
        number: int,
    ) -> None:
        self.schema = schema
        self.type_name = schema.type_name
        self.payload = payload
        self.info = info
        self.number = number
        """How many have come since the first looked."""
        self.frames: dict[object, Any] = {}
        """What was made of it for some who look, to be had by others."""
        self._decode = decode
        self._message: Any = self

    @property
    def message(self) -> Any:
        """Raises BusError, or ValueError and its like, for bytes that are no message of the type."""
        if self._message is self:
            self._message = self._decode(self.payload)
        return self._message


class Listener(Protocol):
    """Who looks at a topic."""

    def hear(self, topic: str, heard: Heard) -> None:
        """A message has come. Must not raise."""

    def hear_fault(self, topic: str, text: str) -> None:
        """Why nothing can come."""


class _Tap:
    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.listeners: dict[Listener, None] = {}
        self.news = asyncio.Event()
        self.task: asyncio.Task[None] | None = None
        self.last: Heard | None = None
        self.kept: dict[bytes, deque[Heard]] = {}
        """Of publishers that keep messages for late joiners, by gid: for those who look later than others."""
        self.number = 0


class Taps:
    """The subscriptions of `node`. `follow` it with each graph, so that it knows which types topics have."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._taps: dict[str, _Tap] = {}
        self._kinds: dict[str, tuple[str, str]] = {}
        self._keepers: dict[str, dict[bytes, int]] = {}
        self._ending: set[asyncio.Task[None]] = set()

    def __len__(self) -> int:
        return len(self._taps)

    @property
    def kinds(self) -> Mapping[str, tuple[str, str]]:
        """Of each topic, the name and the hash of the type that is looked at."""
        return self._kinds

    def follow(self, graph: Graph) -> None:
        """Types of topics have come or gone, or publishers that keep messages for late joiners."""
        kinds: dict[str, tuple[str, str]] = {}
        self._keepers = {}
        for one in (*graph.publishers, *graph.subscriptions):
            if one.node.name != self._node.name:
                kinds.setdefault(one.topic, (one.type_name, one.type_hash))
            if one.kind == "publisher" and one.qos.durability is Durability.TRANSIENT_LOCAL:
                depth = min(one.qos.depth, _DEPTHS.get(one.topic, _DEPTH))
                self._keepers.setdefault(one.topic, {})[one.gid] = depth
        before, self._kinds = self._kinds, kinds
        for topic, tap in self._taps.items():
            keepers = self._keepers.get(topic, {})
            tap.kept = {gid: kept for gid, kept in tap.kept.items() if gid in keepers}
            if before.get(topic) != kinds.get(topic):
                tap.news.set()

    def add(self, topic: str, listener: Listener, *, is_last_wanted: bool = True) -> None:
        """From now on it hears; first, what publishers keep for late joiners, or the last message, where
        others have had one and it `is_last_wanted`."""
        tap = self._taps.get(topic)
        if tap is None:
            tap = self._taps[topic] = _Tap(topic)
            tap.task = asyncio.get_running_loop().create_task(self._keep(tap))
        tap.listeners[listener] = None
        kept = sorted((one for those in tap.kept.values() for one in those), key=lambda one: one.number)
        if not kept and is_last_wanted and tap.last is not None:
            kept = [tap.last]
        for heard in kept:
            listener.hear(topic, heard)

    def remove(self, topic: str, listener: Listener) -> None:
        """It hears no more; where it was the last, the subscription ends."""
        tap = self._taps.get(topic)
        if tap is None:
            return
        tap.listeners.pop(listener, None)
        if not tap.listeners:
            del self._taps[topic]
            self._end(tap)

    async def close(self) -> None:
        """End all of them."""
        for tap in self._taps.values():
            self._end(tap)
        self._taps.clear()
        while self._ending:
            await asyncio.wait([*self._ending])

    def _end(self, tap: _Tap) -> None:
        task = tap.task
        if task is not None:
            self._ending.add(task)
            task.add_done_callback(self._ending.discard)
            task.cancel()

    async def _keep(self, tap: _Tap) -> None:
        """The subscription, of the type that the topic has just now."""
        subscription: Subscription[Any] | None = None
        kind: tuple[str, str] | None = None
        try:
            while True:
                tap.news.clear()
                wanted = self._kinds.get(tap.topic)
                if wanted is not None and (wanted != kind or subscription is None):
                    if subscription is not None:
                        await subscription.close()
                        subscription = None
                        tap.last = None
                        tap.kept.clear()
                    kind = wanted
                    try:
                        subscription = await self._subscribe(tap, kind)
                    except BusError as error:
                        for listener in [*tap.listeners]:
                            listener.hear_fault(tap.topic, str(error))
                await tap.news.wait()
        finally:
            if subscription is not None:
                with suppress(BusError):
                    await subscription.close()

    async def _subscribe(self, tap: _Tap, kind: tuple[str, str]) -> Subscription[Any]:
        schema = await self._node.get_schema(*kind)
        decode = _decoder(schema)

        def hear(payload: bytes, info: MessageInfo) -> None:
            tap.number += 1
            heard = tap.last = Heard(schema, decode, payload, info, tap.number)
            depth = self._keepers.get(tap.topic, {}).get(info.publisher_gid)
            if depth:
                tap.kept.setdefault(info.publisher_gid, deque(maxlen=depth)).append(heard)
            for listener in [*tap.listeners]:
                listener.hear(tap.topic, heard)

        at_once = sum(self._keepers.get(tap.topic, {}).values())  # of all at the beginning
        profile = QoSProfile(
            max(_DEPTHS.get(tap.topic, _DEPTH), min(at_once, _MOST_AT_ONCE)),
            reliability=Reliability.BEST_EFFORT,
            durability=Durability.BEST_AVAILABLE,
        )
        return await self._node.create_subscription(schema, tap.topic, profile, hear, raw=True)


def _decoder(schema: MessageSchema) -> Callable[[Any], Any]:
    """A class is made when the first message is looked at: Foxglove needs none."""
    made: list[Callable[[Any], Any]] = []

    def decode(payload: Any) -> Any:
        if not made:
            made.append(support_of(schema, raw=False).decode)
        return made[0](payload)

    return decode

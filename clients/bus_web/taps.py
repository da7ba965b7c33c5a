"""What pages look at: one subscription for each topic, however many look, as long as one does.

Best effort, with room for five: who looks holds nobody up. Messages come encoded; who wants values decodes
those it shows.
"""

import asyncio
from collections.abc import Callable
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


class Heard:
    """A message of a topic; decoded when the first asks, for all that ask."""

    __slots__ = ("_decode", "_message", "frames", "info", "number", "payload", "type_name")

    def __init__(
        self, type_name: str, decode: Callable[[Any], Any], payload: bytes, info: MessageInfo, number: int
    ) -> None:
        self.type_name = type_name
        self.payload = payload
        self.info = info
        self.number = number
        """How many have come since the first looked."""
        self.frames: dict[object, bytes] = {}
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
        self.number = 0


class Taps:
    """The subscriptions of `node`. `follow` it with each graph, so that it knows which types topics have."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._taps: dict[str, _Tap] = {}
        self._kinds: dict[str, tuple[str, str]] = {}
        self._ending: set[asyncio.Task[None]] = set()

    def __len__(self) -> int:
        return len(self._taps)

    def follow(self, graph: Graph) -> None:
        """Types of topics have come or gone."""
        kinds: dict[str, tuple[str, str]] = {}
        for one in (*graph.publishers, *graph.subscriptions):
            if one.node.name != self._node.name:
                kinds.setdefault(one.topic, (one.type_name, one.type_hash))
        before, self._kinds = self._kinds, kinds
        for topic, tap in self._taps.items():
            if before.get(topic) != kinds.get(topic):
                tap.news.set()

    def add(self, topic: str, listener: Listener) -> None:
        """From now on it hears; first the last message, where others have had one."""
        tap = self._taps.get(topic)
        if tap is None:
            tap = self._taps[topic] = _Tap(topic)
            tap.task = asyncio.get_running_loop().create_task(self._keep(tap))
        tap.listeners[listener] = None
        if tap.last is not None:
            listener.hear(topic, tap.last)

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
            heard = tap.last = Heard(schema.type_name, decode, payload, info, tap.number)
            for listener in [*tap.listeners]:
                listener.hear(tap.topic, heard)

        profile = QoSProfile(
            _DEPTHS.get(tap.topic, _DEPTH),
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

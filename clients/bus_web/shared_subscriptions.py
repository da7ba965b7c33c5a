"""One shared subscription for each viewed topic, for any number of viewers, as long as there is one.

The subscription is best effort with depth five, so viewers block no publisher. Messages come encoded; a
page decodes only the messages that it shows.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Protocol

from bus.errors import BusError
from bus.graph import Graph
from bus.node import Node
from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema, support_of
from bus.subscription import MessageInfo, Subscription
from bus_web.kept import Kept, One

__all__ = ["Heard", "Listener", "SharedSubscriptions", "TypeKind"]

TypeKind = tuple[str, str]
"""A type's name and hash."""

_DEPTHS = {"/rosout": 200}
"""Viewers of a log want its last lines."""
_DEPTH = 5
_MOST_AT_ONCE = 200
_AGAIN_S = 5.0
"""After a refusal of busd: its reason, such as a limit, may end without a change of the graph."""
_NOT_DECODED = object()


class Heard:
    """A message of a topic. The first viewer that asks decodes it for all viewers."""

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
        """Number of messages received since the first viewer came."""
        self.frames: dict[object, Any] = {}
        """Frames made from the message for some viewers, for reuse by others."""
        self._decode = decode
        self._message: Any = _NOT_DECODED  # not itself: only the garbage collector would find it then

    @property
    def message(self) -> Any:
        """Raises BusError, or ValueError and its like, for bytes that are no message of the type."""
        if self._message is _NOT_DECODED:
            self._message = self._decode(self.payload)
        return self._message


class Listener(Protocol):
    """Receives the messages of a topic."""

    def on_message(self, topic: str, heard: Heard) -> None:
        """A message has come. Must not raise."""

    def on_fault(self, topic: str, text: str) -> None:
        """The reason why no message can come."""


class _Shared:
    """The subscription of one topic, of the type that this has just now; `close` it in the end."""

    def __init__(self, node: Node, topic: str, kept: Kept) -> None:
        self.listeners: dict[Listener, None] = {}
        self.fault = ""
        """The reason why no message can come; empty if there is none."""
        self._node = node
        self._topic = topic
        self._kept = kept
        """The last messages of publishers, for viewers that come later than others."""
        self._kind: TypeKind | None = None
        self._depths: Mapping[bytes, int] = {}
        """Depths of publishers that keep messages for late joiners, by gid."""
        self._make: Callable[[One], Heard] | None = None
        """Makes a `Heard` from a message of the subscription's type."""
        self._last: Heard | None = None
        self._count = 0
        self._is_other_type = asyncio.Event()
        self._task = asyncio.get_running_loop().create_task(self._run())

    def follow(self, kind: TypeKind | None, depths: Mapping[bytes, int]) -> None:
        """Set the topic's type (None if no endpoint has one) and the depth that each publisher keeps."""
        self._depths = depths
        self._kept.retain(self._topic, depths)
        if kind != self._kind:
            self._kind = kind
            self.fault = ""
            self._is_other_type.set()

    def recent(self, *, is_last_wanted: bool) -> list[Heard]:
        """Messages for a viewer that comes later than others."""
        kept = self._kept.of_topic(self._topic) if self._make is not None else []
        if not kept and is_last_wanted and self._last is not None:
            return [self._last]
        return [self._make(one) for one in kept] if self._make is not None else []

    def close(self) -> asyncio.Task[None]:
        """Returns a task that is done once the subscription has ended."""
        self._depths = {}  # later messages are not kept
        self._kept.retain(self._topic, ())
        self._task.cancel()
        return self._task

    async def _run(self) -> None:
        subscription: Subscription[Any] | None = None
        kind: TypeKind | None = None
        try:
            while True:
                self._is_other_type.clear()
                wanted = self._kind
                if wanted is not None and (wanted != kind or subscription is None):
                    if subscription is not None:
                        await subscription.close()
                        subscription = None
                        self._last = None
                        self._make = None
                        self._kept.retain(self._topic, ())
                    kind = wanted
                    try:
                        subscription = await self._subscribe(kind)
                        self.fault = ""
                    except TimeoutError:  # busd says nothing for long, which the looks say: ask again
                        continue
                    except BusError as error:
                        self._fail(str(error))
                with suppress(TimeoutError):
                    async with asyncio.timeout(_AGAIN_S if self.fault else None):
                        await self._is_other_type.wait()
        finally:
            if subscription is not None:
                with suppress(BusError):
                    await subscription.close()

    def _fail(self, text: str) -> None:
        if text != self.fault:
            self.fault = text
            for listener in [*self.listeners]:
                listener.on_fault(self._topic, text)

    async def _subscribe(self, kind: TypeKind) -> Subscription[Any]:
        schema = await self._node.get_schema(*kind)
        decode = _decoder(schema)

        def make(one: One) -> Heard:
            return Heard(schema, decode, one.payload, one.info, one.number)

        def on_message(payload: bytes, info: MessageInfo) -> None:
            self._count += 1
            one = One(payload, info, self._count)
            heard = self._last = make(one)
            if depth := self._depths.get(info.publisher_gid):
                self._kept.put(self._topic, info.publisher_gid, one, depth)
            for listener in [*self.listeners]:
                listener.on_message(self._topic, heard)

        self._make = make
        at_once = sum(self._depths.values())  # of all at the beginning
        profile = QoSProfile(
            max(_depth_of(self._topic), min(at_once, _MOST_AT_ONCE)),
            reliability=Reliability.BEST_EFFORT,
            durability=Durability.BEST_AVAILABLE,
        )
        return await self._node.create_subscription(schema, self._topic, profile, on_message, raw=True)


class SharedSubscriptions:
    """The subscriptions of `node`. Call `follow` with each graph: it gives the types of topics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._shared: dict[str, _Shared] = {}
        self._kept = Kept()
        self._kinds: dict[str, TypeKind] = {}
        self._depths: dict[str, dict[bytes, int]] = {}
        self._ending: set[asyncio.Task[None]] = set()

    @property
    def kinds(self) -> Mapping[str, TypeKind]:
        """The viewed type of each topic."""
        return self._kinds

    def follow(self, graph: Graph) -> None:
        """Types of topics have come or gone, or publishers that keep messages for late joiners."""
        kinds: dict[str, TypeKind] = {}
        self._depths = {}
        for one in (*graph.publishers, *graph.subscriptions):
            if one.node.name != self._node.name:
                kinds.setdefault(one.topic, (one.type_name, one.type_hash))
            if one.kind == "publisher" and one.qos.durability is Durability.TRANSIENT_LOCAL:
                self._depths.setdefault(one.topic, {})[one.gid] = min(one.qos.depth, _depth_of(one.topic))
        self._kinds = kinds
        for topic in self._shared:
            self._follow(topic)

    def add(self, topic: str, listener: Listener, *, is_last_wanted: bool = True) -> None:
        """Add a listener. It first gets the messages that publishers keep for late joiners. If there are
        none, it gets the last message that other listeners have had, if `is_last_wanted`."""
        if topic not in self._shared:
            self._shared[topic] = _Shared(self._node, topic, self._kept)
            self._follow(topic)
        shared = self._shared[topic]
        shared.listeners[listener] = None
        if shared.fault:
            listener.on_fault(topic, shared.fault)
        for heard in shared.recent(is_last_wanted=is_last_wanted):
            listener.on_message(topic, heard)

    def remove(self, topic: str, listener: Listener) -> None:
        """Remove a listener; if it was the last, the subscription ends."""
        shared = self._shared.get(topic)
        if shared is None:
            return
        shared.listeners.pop(listener, None)
        if not shared.listeners:
            self._end(self._shared.pop(topic))

    async def close(self) -> None:
        """End all of them."""
        while self._shared:
            self._end(self._shared.popitem()[1])
        while self._ending:
            await asyncio.wait([*self._ending])

    def _follow(self, topic: str) -> None:
        self._shared[topic].follow(self._kinds.get(topic), self._depths.get(topic, {}))

    def _end(self, shared: _Shared) -> None:
        task = shared.close()
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)


def _depth_of(topic: str) -> int:
    return _DEPTHS.get(topic, _DEPTH)


def _decoder(schema: MessageSchema) -> Callable[[Any], Any]:
    """A class is made when the first message is looked at: Foxglove needs none."""
    made: list[Callable[[Any], Any]] = []

    def decode(payload: Any) -> Any:
        if not made:
            made.append(support_of(schema, raw=False).decode)
        return made[0](payload)

    return decode

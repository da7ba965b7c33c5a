"""The newest message of a topic as text, for `bus top`."""

from typing import Any

from msgspec.structs import replace

from bus.base.printable import printable
from bus.graph import Graph
from bus.node import Node
from bus.qos import PRESETS
from bus.subscription import MessageInfo, Subscription
from bus.types.support import type_support
from bus_cli.output import CommandError
from bus_cli.qosargs import serving_all
from bus_cli.render import View, to_text
from bus_cli.stream import find_class
from bus_cli.top.figures import seconds_text
from bus_cli.top.table import Line

__all__ = ["Values"]

_LONGEST = 128
_MOST_ITEMS = 8
_MOST_LINES = 2000


class Values:
    """The messages of `topic`, from `open` until `close`. Only messages that are shown are decoded."""

    def __init__(self, node: Node, graph: Graph, topic: str) -> None:
        self._node, self._graph, self._topic = node, graph, topic
        self._subscription: Subscription[Any] | None = None
        self._is_closed = False
        self._class: Any = None
        self._newest: tuple[memoryview, MessageInfo] | None = None
        self._count = 0
        self._why = "no message yet"
        self.has_news = True
        """Whether there is something new since the last call of `lines`."""

    async def open(self) -> None:
        """Subscribe. If that fails, `lines` returns the reason."""
        try:
            self._class = await find_class(self._node, self._graph, self._topic)
        except CommandError as error:
            self._say(str(error))
            return
        if self._class is None:
            self._say("it has no publisher and no subscription any more")
            return
        offers = [one.qos for one in self._graph.publishers_of(self._topic)]
        qos = replace(serving_all(PRESETS["sensor_data"], offers), depth=5)
        self._subscription = await self._node.create_subscription(
            self._class, self._topic, qos, self._on_message, raw=True
        )
        if self._is_closed:
            await self.close()

    async def close(self) -> None:
        self._is_closed = True
        self._newest = None
        if self._subscription is not None:
            subscription, self._subscription = self._subscription, None
            await subscription.close()

    @property
    def about(self) -> str:
        if self._newest is None:
            return self._topic
        info = self._newest[1]
        age_s = max(0.0, (info.received_timestamp - info.source_timestamp) / 1e9)
        return f"{self._topic}  message {self._count}, {seconds_text(age_s)} old on arrival"

    def lines(self) -> list[Line]:
        """The newest message, as YAML."""
        self.has_news = False
        if self._newest is None:
            return [Line(self._why)]
        support = type_support(self._class)
        try:
            message = support.decode(self._newest[0])
        except Exception as error:  # for example, the bytes do not fit the type
            return [Line(printable(f"no {support.name}: {error}"))]
        view = View(truncate_length=_LONGEST, octets=True)
        plain = _fold(view.plain(support.schema, support.schema["root"], message))
        return [Line(line) for line in to_text(plain).splitlines()[:_MOST_LINES]]

    def _on_message(self, payload: Any, info: MessageInfo) -> None:
        self._newest = payload, info
        self._count += 1
        self.has_news = True

    def _say(self, why: str) -> None:
        self._why, self.has_news = why, True


def _fold(plain: Any) -> Any:
    """Shorten long arrays, which would fill the screen."""
    match plain:
        case dict():
            return {name: _fold(part) for name, part in plain.items()}
        case list() if len(plain) > _MOST_ITEMS:
            return [*map(_fold, plain[:_MOST_ITEMS]), "..."]
        case list():
            return [*map(_fold, plain)]
    return plain

"""Says on stderr why `echo` prints nothing.

The library itself warns of a mismatch of QoS or type, and names the node. This is about the rest: no node
publishes, the publishers send nothing, or the filter lets nothing through.
"""

import asyncio
from typing import Any

from bus.errors import BusError
from bus.node import Node
from bus.subscription import Subscription
from bus_cli.output import complain

__all__ = ["Silence"]

_PATIENCE_S = 2.0


class Silence:
    """Watches one subscription. Its user counts the messages `received` and those `shown`."""

    def __init__(self, node: Node, topic: str) -> None:
        self.received = 0
        self.shown = 0
        self._node = node
        self._topic = topic
        self._last_reason = ""

    async def watch(self, subscription: Subscription[Any]) -> None:
        """Until it is cancelled, say each reason once."""
        await self._check(subscription, patient=True)
        while True:
            shown = self.shown
            await asyncio.sleep(_PATIENCE_S)
            if self.shown > shown:
                self._last_reason = ""
            else:
                await self._check(subscription, patient=False)

    async def _check(self, subscription: Subscription[Any], *, patient: bool) -> None:
        reason = await self._nobody_publishes()
        if reason is None and not patient:
            reason = self._nothing_shown(subscription)
        if reason is not None and reason != self._last_reason:
            complain(reason)
            self._last_reason = reason

    async def _nobody_publishes(self) -> str | None:
        try:
            graph = await self._node.graph()
        except (BusError, TimeoutError):
            return None  # the link says so, and comes back
        if graph.publishers_of(self._topic):
            return None
        from bus.base.suggest import did_you_mean

        published = {publisher.topic for publisher in graph.publishers} - {self._topic}
        hint = did_you_mean(self._topic, published, 0.75)
        return f"no node publishes on '{self._topic}'{hint} (waiting)"

    def _nothing_shown(self, subscription: Subscription[Any]) -> str | None:
        """A topic that has shown something may be a slow one."""
        nodes = sorted({match.node for match in subscription.matches})
        if self.shown or not nodes:
            return None
        if self.received:
            return f"messages come on '{self._topic}', but none has passed the filter yet"
        verb = "publishes" if len(nodes) == 1 else "publish"
        return f"no message yet on '{self._topic}'; {', '.join(nodes)} {verb} it, but sent nothing"

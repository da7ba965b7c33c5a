"""Nodes for scripts, and their publishers and subscriptions: every call waits."""

from bus.base import lean_asyncio  # noqa: F401 - ahead of all that imports asyncio
from bus.blocking.endpoint import BlockingPublisher, BlockingSubscription
from bus.blocking.node import BlockingNode, connect

__all__ = ["BlockingNode", "BlockingPublisher", "BlockingSubscription", "connect"]

"""Nodes for scripts, and their publishers and subscriptions: every call waits."""

from bus.blocking.endpoint import BlockingPublisher, BlockingSubscription
from bus.blocking.node import BlockingNode, connect

__all__ = ["BlockingNode", "BlockingPublisher", "BlockingSubscription", "connect"]

"""The node, with what it opens and what it logs."""

from bus.node.node import SERVICE_QOS, Node

__all__ = ["SERVICE_QOS", "Node"]

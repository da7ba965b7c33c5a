"""The time of the bus, if a node publishes it: simulated, or from a recording."""

from bus.graph import Graph
from bus_web.shared_subscriptions import Heard

__all__ = ["CLOCK", "Clock"]

CLOCK, _TYPE = "/clock", "rosgraph_msgs/msg/Clock"


class Clock:
    """The time of `/clock`, as long as the topic exists."""

    def __init__(self) -> None:
        self.is_there = False
        self.now_ns = 0
        """0 until a message has come."""

    def follow(self, graph: Graph, *, keep: bool) -> bool:
        """Look for a publisher; returns whether the clock has come or gone. `keep`: it does not go."""
        was_there = self.is_there
        is_published = any(one.type_name == _TYPE for one in graph.publishers_of(CLOCK))
        self.is_there = is_published or (keep and was_there)
        return self.is_there != was_there

    def update(self, heard: Heard) -> bool:
        """Take the time of a message; returns whether it had one."""
        try:
            stamp = heard.message.clock
            self.now_ns = max(0, stamp.sec) * 1_000_000_000 + stamp.nanosec
        except Exception:  # bytes of a stranger
            return False
        return True

"""The route out of a publisher of this bus to ROS 2 on zenoh."""

from collections.abc import Callable

from bus.qos import Durability, QoSProfile, Reliability
from bus_bridge.engine import Priority
from bus_bridge.rmw_zenoh import attachment
from bus_bridge.rmw_zenoh.keys import gid_of
from bus_bridge.rmw_zenoh.session import RosOutlet, RosSession
from bus_bridge.ros2 import samples
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.ros2.route_out import RouteOut

__all__ = ["RosWriter"]

_MOST_KEPT = 10_000
"""Messages for late joiners of a publisher that keeps all."""


class RosWriter(RouteOut):
    """`token` announces the publisher, and ends with it."""

    def __init__(
        self,
        session: RosSession,
        key: str,
        token: str,
        known: KnownType,
        qos: QoSProfile,
        priority: Priority,
        on_change: Callable[[], None],
        on_close: Callable[[RouteOut], object],
    ) -> None:
        super().__init__(known, on_change, on_close)
        self.gid = gid_of(token)
        self._number = 0
        kept = qos.depth or _MOST_KEPT if qos.durability is Durability.TRANSIENT_LOCAL else None
        # Otherwise zenoh drops messages without room in its queue, and reports nothing.
        waits = qos.reliability is Reliability.RELIABLE
        self._outlet = RosOutlet(session, key, self._outlet_changed, kept, priority, waits=waits)
        self._token = session.token(token)  # after the publisher, as in rmw_zenoh

    def _outlet_changed(self) -> None:
        if self.is_closed:
            return
        if self.is_wanted == self._outlet.is_wanted:
            self._on_change()  # there is room
        self.update()

    def _has_reader(self) -> bool:
        return self._outlet.is_wanted

    def _encoded(self, payload: bytes) -> bytes:
        return samples.joined(self._codec, payload)

    def _send(self, cdr: bytes, time_ns: int) -> bool:
        # Numbers belong to this link: messages that a rule leaves out are no losses on it.
        if not self._outlet.put(cdr, attachment.write(self._number + 1, time_ns, self.gid)):
            return False
        self._number += 1
        return True

    def _wait_for_room(self) -> None:
        """The outlet reports room."""

    def _end(self) -> None:
        self._token.undeclare()
        self._outlet.undeclare()

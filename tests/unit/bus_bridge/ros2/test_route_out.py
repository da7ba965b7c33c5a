"""bus_bridge.ros2.route_out: what a carrier gets to send, without a carrier."""

from collections.abc import Callable
from typing import Any

from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus.types.support import type_support
from bus_bridge.batch import Loose, Sample
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.ros2.route_out import RouteOut

STRING = message_class("std_msgs/msg/String")
PAYLOAD = bytes(type_support(STRING).encode(STRING(data="a")))


class Later:
    """Stands for the event loop, and for its timer."""

    def __init__(self) -> None:
        self.pauses_s: list[float] = []
        self.is_cancelled = False

    def call_later(self, pause_s: float, call: Callable[[], object]) -> Any:
        self.pauses_s.append(pause_s)
        self.expire = call
        return self

    def cancel(self) -> None:
        self.is_cancelled = True


class Route(RouteOut):
    """Sends into a list while there is room."""

    def __init__(self) -> None:
        super().__init__(KnownType(MessageSchema.of(STRING)), self.changed, self.closings)
        self._loop: Any
        self.has_reader = True
        self.room = 1000
        self.sent: list[int] = []
        self.changes = 0
        self.closed = 0
        self.ended = 0

    def changed(self) -> None:
        self.changes += 1

    def closings(self, route: RouteOut) -> None:
        self.closed += 1

    def _has_reader(self) -> bool:
        return self.has_reader

    def _send(self, cdr: bytes, time_ns: int) -> bool:
        self.room -= 1
        if self.room >= 0:
            self.sent.append(time_ns)
        return self.room >= 0

    def _end(self) -> None:
        self.ended += 1


def batch(*numbers: int, payload: bytes = PAYLOAD) -> Loose:
    return Loose([Sample(payload, number, number) for number in numbers])


async def test_a_message_goes_once() -> None:
    route = Route()
    assert route.write(batch(1, 2, 3)) == 3
    assert route.write(batch(2, 3, 4)) == 3
    assert route.write(batch(4)) == 1
    assert route.sent == [1, 2, 3, 4]


async def test_messages_without_a_number_all_go() -> None:
    route = Route()
    route.write(batch(1))
    assert route.write(batch(0, 0)) == 2
    assert route.sent == [1, 0, 0]


async def test_what_is_no_message_of_the_type_is_counted() -> None:
    route = Route()
    assert route.write(batch(1, 2, payload=b"\xff")) == 2
    assert (route.sent, dict(route.lost)) == ([], {"undecodable": 2})


async def test_the_reader_is_reported_at_each_change() -> None:
    route = Route()
    route.update()
    route.update()
    assert route.is_wanted and route.changes == 1
    route.has_reader = False
    route.update()
    assert not route.is_wanted and route.changes == 2


async def test_without_room_the_pauses_grow_until_all_has_gone() -> None:
    route, later = Route(), Later()
    route._loop = later
    route.room = 0
    for tries in range(1, 8):
        assert route.write(batch(1)) == 0
        assert route.write(batch(1)) == 0  # it waits already
        later.expire()
        assert route.changes == tries
    assert later.pauses_s == [0.001, 0.002, 0.004, 0.008, 0.016, 0.02, 0.02]
    route.room = 1
    assert route.write(batch(1)) == 1
    assert route.write(batch(2)) == 0
    assert later.pauses_s[7:] == [0.001]


async def test_a_closed_route_takes_all_and_sends_nothing() -> None:
    route, later = Route(), Later()
    route._loop = later
    route.room = 0
    route.write(batch(1))
    route.close()
    route.close()
    assert later.is_cancelled
    route.update()
    assert route.write(batch(2, 3)) == 2
    assert (route.closed, route.ended) == (1, 1)
    assert (route.sent, route.changes, route.is_wanted) == ([], 0, False)

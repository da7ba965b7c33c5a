"""The time of the bus, if a node publishes it."""

from types import SimpleNamespace
from typing import Any

from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import String
from bus_web.foxglove.clock import CLOCK, Clock
from web_world import WebWorld


def heard(message: Any) -> Any:
    return SimpleNamespace(message=message)


def test_it_comes_and_goes() -> None:
    world, clock = WebWorld(), Clock()
    world.add("subscription", "/robot", CLOCK, type_name="rosgraph_msgs/msg/Clock", type_hash="h")
    assert (clock.follow(world.look(), keep=False), clock.is_there) == (False, False), "nobody publishes it"
    world.add("publisher", "/sim", CLOCK, type_name="rosgraph_msgs/msg/Clock", type_hash="h")
    assert (clock.follow(world.look(), keep=False), clock.is_there) == (True, True)
    assert not clock.follow(world.look(), keep=False)
    world.remove(CLOCK)
    assert (clock.follow(world.look(), keep=True), clock.is_there) == (False, True), "busd was away"
    assert (clock.follow(world.look(), keep=False), clock.is_there) == (True, False)


def test_one_of_another_type_is_none() -> None:
    world, clock = WebWorld(), Clock()
    world.add("publisher", "/sim", CLOCK, String)
    assert not clock.follow(world.look(), keep=False)


def test_what_it_says() -> None:
    clock = Clock()
    assert clock.update(heard(SimpleNamespace(clock=Time(sec=5, nanosec=7))))
    assert clock.now_ns == 5_000_000_007
    assert clock.update(heard(SimpleNamespace(clock=Time(sec=-5, nanosec=7))))
    assert clock.now_ns == 7, "the protocol has no time before 1970"
    assert not clock.update(heard(String(data="no clock")))
    assert clock.now_ns == 7

"""Simulated time in the facade: clocks, timers and rates that follow /clock."""

from collections.abc import Callable
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.clock import ClockType
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.time import Time
from bus_ros.rosidl import message_class
from rclpy_world import World, arguments, in_thread, is_waiting, wait_until, world

__all__ = ["arguments", "world"]

LONG_S = 3600
S = 10**9
ClockMessage: Any = message_class("rosgraph_msgs/msg/Clock")


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


@pytest.fixture
def at(world: World, node: Node) -> Callable[[float], None]:
    """Sets the simulation's time, and lets the node act on it."""
    simulator = world.node("simulator")
    publisher = simulator.create_publisher(ClockMessage, "/clock", 1)

    def at(seconds: float) -> None:
        time_ns = round(seconds * S)
        publisher.publish(ClockMessage(clock=Time(nanoseconds=time_ns).to_msg()))
        world.spin_until(lambda: node.get_clock().now().nanoseconds == time_ns, node)
        for _ in range(5):
            rclpy.spin_once(node, timeout_sec=0)

    return at


@pytest.fixture
def simulated(node: Node) -> Node:
    use_sim_time(node, True)
    return node


def test_the_clock_follows(world: World, simulated: Node, at: Callable[[float], None]) -> None:
    clock = simulated.get_clock()
    assert clock.ros_time_is_active and clock.now().nanoseconds == 0
    at(12.5)
    assert clock.now() == Time(seconds=12, nanoseconds=5 * S // 10, clock_type=ClockType.ROS_TIME)
    use_sim_time(simulated, False)
    assert clock.now().nanoseconds > 10**18


@pytest.mark.parametrize("arguments", [["--ros-args", "-p", "use_sim_time:=true"]])
def test_by_the_command_line(world: World, node: Node, at: Callable[[float], None]) -> None:
    assert node.get_clock().ros_time_is_active
    assert node.get_parameter("use_sim_time").value is True


def test_timers_go_by_it(world: World, simulated: Node, at: Callable[[float], None]) -> None:
    calls: list[int] = []
    at(1000)
    timer = simulated.create_timer(10, lambda: calls.append(1))
    at(1009)
    assert calls == [] and timer.time_until_next_call() == S
    at(1010)
    assert calls == [1]
    at(1045)
    assert calls == [1, 1]
    at(1050)
    assert calls == [1, 1, 1] and timer.time_since_last_call() == 0


def test_timers_when_the_simulation_begins_anew(
    world: World, simulated: Node, at: Callable[[float], None]
) -> None:
    calls: list[int] = []
    at(1000)
    simulated.create_timer(10, lambda: calls.append(1))
    at(1011)
    assert calls == [1]
    at(1)
    assert calls == [1]
    at(11)
    assert calls == [1, 1]


def test_timers_made_before(world: World, node: Node, at: Callable[[float], None]) -> None:
    """The remaining time counts by the new clock."""
    calls: list[int] = []
    node.create_timer(LONG_S, lambda: calls.append(1))
    use_sim_time(node, True)
    at(1)
    at(LONG_S - 600)
    assert calls == []
    at(LONG_S + 10)
    assert calls == [1]


def test_who_waits_sees_the_change(world: World, node: Node) -> None:
    calls: list[int] = []
    publisher = world.node("simulator").create_publisher(ClockMessage, "/clock", 1)
    node.create_timer(LONG_S, lambda: calls.append(1))
    with world.spinning(node) as executor:
        wait_until(lambda: is_waiting(executor))
        use_sim_time(node, True)
        for seconds in (1, LONG_S + 2):
            publisher.publish(ClockMessage(clock=Time(seconds=seconds).to_msg()))
            wait_until(lambda seconds=seconds: node.get_clock().now().nanoseconds == seconds * S)
        wait_until(lambda: calls)


def test_rates_and_sleeps(world: World, simulated: Node) -> None:
    """They end when the simulation reaches their time."""
    publisher = world.node("simulator").create_publisher(ClockMessage, "/clock", 1)
    clock, rate = simulated.get_clock(), simulated.create_rate(1 / 60)
    slept: list[str] = []

    def sleep() -> None:
        rate.sleep()
        slept.append("rate")
        clock.sleep_for(Duration(seconds=60))
        slept.append("clock")

    with world.spinning(simulated), in_thread(sleep):
        for seconds in range(0, 100_000, 30):
            publisher.publish(ClockMessage(clock=Time(seconds=seconds).to_msg()))
            wait_until(lambda seconds=seconds: clock.now().nanoseconds == seconds * S)
            if len(slept) == 2:
                break
    assert slept == ["rate", "clock"]


def use_sim_time(node: Node, value: bool) -> None:
    (result,) = node.set_parameters([Parameter("use_sim_time", value=value)])
    assert result.successful

"""diagnostic_updater in a node: its messages and its log."""

from typing import Any

import pytest

from bus_ros.diagnostic_updater import (
    DiagnosedPublisher,
    FrequencyStatusParam,
    HeaderlessTopicDiagnostic,
    Heartbeat,
    TimeStampStatusParam,
    Updater,
)
from bus_ros.rosidl import message_class
from rclpy_world import World, arguments, world

__all__ = ["arguments", "world"]

DiagnosticArray: Any = message_class("diagnostic_msgs/msg/DiagnosticArray")
Temperature: Any = message_class("sensor_msgs/msg/Temperature")
OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
NO_HARDWARE = (
    "diagnostic_updater: No HW_ID was set. This is probably a bug. Please report it. For devices that"
)


def test_what_is_published(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    node, other = world.node("driver"), world.node("monitor")
    heard: list[Any] = []
    other.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 100)
    updater = Updater(node, period=1000.0)

    def next_one() -> list[tuple[bytes, str, str]]:
        world.spin_until(lambda: heard)
        array = heard.pop(0)
        assert array.header.stamp.sec
        return [(one.level, one.name, one.message) for one in array.status]

    updater.add(Heartbeat())
    assert next_one() == [(OK, "driver: Heartbeat", "Node starting up")]
    updater.update()
    assert next_one() == [(OK, "driver: Heartbeat", "Alive")]
    assert NO_HARDWARE in capsys.readouterr().err
    updater.force_update()
    assert next_one()
    assert NO_HARDWARE not in capsys.readouterr().err

    updater.setHardwareID("lidar 7")
    updater.verbose = True
    updater.add("idle", lambda status: updater.removeByName("Heartbeat") and None)
    assert next_one() == [(OK, "driver: idle", "Node starting up")]
    updater.update()
    assert next_one() == [(OK, "driver: Heartbeat", "Alive"), (ERROR, "driver: idle", "No message was set")]
    warned = "Non-zero diagnostic status. Name: idle, status b'\\x02': No message was set"
    assert warned in capsys.readouterr().err
    assert not updater.removeByName("Heartbeat")
    updater.broadcast(WARN, "leaving")
    assert next_one() == [(WARN, "driver: idle", "leaving")]
    with pytest.raises(TypeError, match=r"add\(\) takes a task, or a name and a function, not 3 arguments"):
        updater.add("a", print, 1)


def test_the_period_is_a_parameter(world: World) -> None:
    node, other = world.node("driver", namespace="/left"), world.node("monitor")
    node.declare_parameter("diagnostic_updater.use_fqn", True)
    heard: list[Any] = []
    other.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 100)
    updaters = [Updater(node, 1000.0), Updater(node)]
    assert [one.period for one in updaters] == [1000.0, 1000.0]
    updaters[0].add("one", lambda status: status)
    updaters[1].period = 0.01
    assert len(list(node.timers)) == 2
    world.spin_until(lambda: len(heard) > 3)
    assert heard[0].status[0].name == "/left/driver: one"


def test_publishers_that_watch_themselves(world: World) -> None:
    node = world.node("camera")
    updater = Updater(node, 1000.0)
    updater.setHardwareID("none")
    often = FrequencyStatusParam({"min": 0.001})
    publisher = node.create_publisher(Temperature, "heat", 10)
    watched = DiagnosedPublisher(publisher, updater, often, TimeStampStatusParam())
    heard: list[Any] = []
    node.create_subscription(Temperature, "heat", heard.append, 10)
    message = Temperature()
    message.header.stamp = node.get_clock().now().to_msg()
    watched.publish(message)
    world.spin_until(lambda: heard)
    headerless = HeaderlessTopicDiagnostic("/ticks", updater, often)
    headerless.tick()
    headerless.clear_window()
    arrays: list[Any] = []
    node.create_subscription(DiagnosticArray, "/diagnostics", arrays.append, 10)
    updater.update()
    world.spin_until(lambda: arrays)
    assert [(one.name, one.message) for one in arrays[-1].status] == [
        ("camera: /heat topic status", "Desired frequency met; Timestamps are reasonable."),
        ("camera: /ticks topic status", "No events recorded."),
    ]
    assert arrays[-1].status[0].hardware_id == "none"

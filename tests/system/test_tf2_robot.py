"""robot_state_publisher and joint_state_publisher: from a description to transforms."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.qos import DurabilityPolicy, QoSProfile
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message_type
from bus_tf2.programs.joint_state_publisher import JointStatePublisher
from bus_tf2.programs.robot_state_publisher import RobotStatePublisher
from bus_tf2.tf2_ros import Buffer, TransformListener
from packaged import run_bus
from rclpy_world import World, arguments, world

__all__ = ["arguments", "world"]

ARM = """<robot name="arm">
<link name="world"/><link name="base"/><link name="upper"/><link name="hand"/><link name="finger"/>
<link name="free"/>
<joint name="fix" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 1"/></joint>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
<joint name="slide" type="prismatic"><parent link="upper"/><child link="hand"/>
<limit lower="0.1" upper="0.5"/></joint>
<joint name="claw" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1"/><mimic joint="slide" multiplier="-2" offset="0.1"/></joint>
<joint name="loose" type="floating"><parent link="base"/><child link="free"/></joint>
</robot>"""
JointState = message_type("sensor_msgs/msg/JointState")


class Watcher:
    """A buffer that receives the published transforms."""

    def __init__(self, node: Node) -> None:
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, node)

    def place(self, frame: str, other: str = "world") -> tuple[float, float, float]:
        found = self.buffer.lookup_transform(other, frame, Time()).transform.translation
        return round(found.x, 6), round(found.y, 6), round(found.z, 6)

    def sees(self, frame: str, place: tuple[float, float, float]) -> Callable[[], bool]:
        return lambda: self.buffer.can_transform("world", frame, Time()) == 1 and self.place(frame) == place


def publisher(world: World, **parameters: Any) -> RobotStatePublisher:
    given = {"robot_description": ARM, **parameters}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = RobotStatePublisher(parameter_overrides=overrides, start_parameter_services=False)
    world.keep(node)
    return node


def state(node: Node, **positions: float) -> Any:
    made = JointState(name=list(positions), position=list(positions.values()))
    made.header.stamp = node.get_clock().now().to_msg()
    return made


def test_states_become_transforms(world: World) -> None:
    node, other = publisher(world), world.node("other")
    watcher = Watcher(other)
    joints = other.create_publisher(JointState, "joint_states", 10)
    joints.publish(state(other, shoulder=math.pi / 2, slide=0.3, stranger=1.0))
    world.spin_until(watcher.sees("finger", (0.5, 0.3, 1.0)))
    assert watcher.place("base") == (0.0, 0.0, 1.0)
    assert not watcher.buffer.can_transform("world", "free", Time())
    assert set(node._sent_ns) == {"shoulder", "slide"}
    watcher.listener.unregister()


def test_no_oftener_than_asked_for(world: World) -> None:
    """With ignore_timestamp, it publishes as often as states arrive."""
    node, other = publisher(world, publish_frequency=0.5), world.node("other")
    sent: list[Any] = []
    other.create_subscription(message_type("tf2_msgs/msg/TFMessage"), "/tf", sent.append, 10)
    for position in (0.1, 0.2, 0.3):
        node._on_joint_states(state(other, slide=position))
    node.set_parameters([Parameter("ignore_timestamp", value=True)])
    node._on_joint_states(state(other, slide=0.4))
    world.spin_until(lambda: len(sent) > 1)
    assert [round(one.transforms[1].transform.translation.x, 3) for one in sent] == [0.1, 0.4]


def test_states_that_are_none(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    node = publisher(world)
    for names, positions in ((["slide"], []), (["slide"], [1.0, 2.0]), ([], [])):
        node._on_joint_states(JointState(name=names, position=positions))
    said = capfd.readouterr().err
    assert 'a JointState message about joint(s) "slide"(,...) whose position member was empty.' in said
    assert said.count("Robot state publisher ignored") == 2


def test_another_robot(world: World) -> None:
    node, other = publisher(world, frame_prefix="one/"), world.node("other")
    watcher = Watcher(other)
    told: list[Any] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    other.create_subscription(message_type("std_msgs/msg/String"), "robot_description", told.append, latched)
    world.spin_until(lambda: watcher.buffer._frameExists("one/base"))
    moved = ARM.replace('xyz="0 0 1"/></joint>', 'xyz="0 0 2"/></joint>', 1)
    [result] = node.set_parameters([Parameter("robot_description", value=moved)])
    assert result.successful
    world.spin_until(lambda: watcher.place("one/base", "one/world") == (0.0, 0.0, 2.0))
    world.spin_until(lambda: len(told) == 2)
    assert [one.data for one in told] == [ARM, moved]
    for name, value, reason in (
        ("robot_description", "", "Empty URDF is not allowed"),
        (
            "robot_description",
            "<robot/>",
            "Unable to initialize urdf::model from robot description: No link elements found in urdf file",
        ),
        ("publish_frequency", 0.0, "publish_frequency must be between 0.0 (exclusive) and 1000.0"),
    ):
        [result] = node.set_parameters([Parameter(name, value=value)])
        assert (result.successful, result.reason) == (False, reason)
    watcher.listener.unregister()


def test_it_says_why_it_does_not_begin(world: World) -> None:
    for parameters, fault in (
        ({"robot_description": ""}, "^robot_description parameter must not be empty$"),
        (
            {"robot_description": "<a/>"},
            "^Unable to initialize urdf::model from robot description: Could not find",
        ),
        ({"publish_frequency": 2000.0}, "^publish_frequency must be between 0 .exclusive. and 1000$"),
    ):
        with pytest.raises(ValueError, match=fault):
            publisher(world, **parameters)


def joint_states(world: World, description: str | None, **parameters: Any) -> JointStatePublisher:
    overrides = [Parameter(name, value=value) for name, value in {"rate": 50, **parameters}.items()]
    node = JointStatePublisher(description, parameter_overrides=overrides, start_parameter_services=False)
    world.keep(node)
    return node


def test_states_without_a_source(world: World) -> None:
    other = world.node("other")
    heard: list[Any] = []
    other.create_subscription(JointState, "joint_states", heard.append, 10)
    joint_states(world, ARM, **{"zeros.shoulder": 1.5, "publish_default_velocities": True})
    world.spin_until(lambda: heard)
    assert list(heard[0].name) == ["shoulder", "slide", "claw"]
    assert list(heard[0].position) == pytest.approx([1.5, 0.3, -0.5])
    assert list(heard[0].velocity) == [0.0, 0.0, 0.0]
    assert not heard[0].effort


def test_states_of_others(world: World) -> None:
    """For the robot in the description of robot_state_publisher."""
    publisher(world)
    other = world.node("other")
    joint_states(world, None, source_list=["arm_states"], use_mimic_tags=False, delta=0.0)
    source = other.create_publisher(JointState, "arm_states", 10)
    source.publish(JointState(name=["slide", "stranger"], position=[0.2, 9.0], effort=[7.0, 9.0]))
    heard: list[Any] = []
    other.create_subscription(JointState, "joint_states", heard.append, 10)
    timer = other.create_timer(
        0.02, lambda: source.publish(JointState(name=["slide"], position=[0.2], effort=[7.0]))
    )
    world.spin_until(lambda: heard and heard[-1].effort)
    timer.cancel()
    assert list(heard[-1].position) == pytest.approx([0.0, 0.2, 0.0])
    assert list(heard[-1].effort) == [0.0, 7.0, 0.0]


def test_joints_that_move(world: World) -> None:
    node = joint_states(world, ARM, delta=0.3, **{"dependent_joints.shoulder.parent": "slide"})
    positions = []
    for _ in range(4):
        node._move(0.3)
        positions.append(round(node._states["slide"]["position"], 3))
    assert positions == [0.5, 0.2, 0.1, 0.4]
    assert node._state_of("shoulder") == {"position": pytest.approx(0.4)}


def test_as_programs(daemon: object, tmp_path: Path) -> None:
    for package in ("robot_state_publisher", "joint_state_publisher"):
        said = run_bus("run", package, package, str(tmp_path / "none.urdf"))
        assert said.code == 1
        assert "can't read the URDF file '" in said.err
        assert "No such file or directory\n" in said.err
        assert "Traceback" not in said.err
    said = run_bus("run", "robot_state_publisher", "robot_state_publisher")
    assert said.code == 1
    assert "[robot_state_publisher]: robot_description parameter must not be empty\n" in said.err

"""robot_state_publisher: which transforms go out for a state of the joints, without a bus."""

from types import SimpleNamespace
from typing import Any, cast

from bus_ros.rclpy.time import Time
from bus_tf2.messages import message
from bus_tf2.programs.robot_state_publisher import RobotStatePublisher
from bus_tf2.tf2_ros import StaticTransformBroadcaster

ROBOT = """<robot name="arm"><link name="world"/><link name="base"/><link name="hand"/><link name="finger"/>
<joint name="fix" type="fixed"><parent link="world"/><child link="base"/></joint>
<joint name="slide" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1"/></joint>
<joint name="claw" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1"/><mimic joint="slide" multiplier="2"/></joint></robot>"""


class Sink:
    """Stands for a publisher, and for the broadcaster of moving transforms."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def publish(self, one: Any) -> None:
        self.sent.append(one)

    sendTransform = publish


class Robot(RobotStatePublisher):
    """Has the robot's joints and the clock of the test, and no node."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.warnings: list[str] = []
        self._frequency, self._prefix, self._ignores_stamps = 20.0, "", False
        self._last_heard_ns = 0
        self._sent_ns: dict[str, int] = {}
        self.still = Sink()
        self.moving = Sink()
        self._describe: Any = Sink()
        self._moving = cast(Any, self.moving)
        self._still = object.__new__(StaticTransformBroadcaster)
        self._still.net_message = message("tf2_msgs/msg/TFMessage")
        self._still.pub_tf = self.still  # type: ignore[assignment]
        self._set_up(ROBOT)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: Time(seconds=self.now_s))

    def get_logger(self) -> Any:
        return SimpleNamespace(info=lambda text: None, warning=self.warnings.append)

    def receive(self, **positions: float) -> dict[str, float]:
        """A state of the present time arrives. Returns the places that go out, by frame."""
        self.moving.sent.clear()
        state = message("sensor_msgs/msg/JointState", name=[*positions], position=[*positions.values()])
        state.header.stamp = self.get_clock().now().to_msg()
        self._on_joint_states(state)
        return {
            one.child_frame_id: one.transform.translation.x for found in self.moving.sent for one in found
        }


def test_a_state_goes_out_when_it_is_due() -> None:
    robot = Robot()
    assert robot.receive(slide=0.25) == {"hand": 0.25, "finger": 0.5}
    robot.now_s += 0.04
    assert robot.receive(slide=0.375) == {}
    robot.now_s += 0.02
    assert robot.receive(slide=0.5) == {"hand": 0.5, "finger": 1.0}


def test_a_joint_with_its_own_state_does_not_follow() -> None:
    assert Robot().receive(slide=0.25, claw=0.125) == {"hand": 0.25, "finger": 0.125}


def test_time_that_goes_back_stops_nothing() -> None:
    robot = Robot()
    robot.receive(slide=0.25)
    robot.now_s = 50.0
    assert robot.receive(slide=0.5) == {"hand": 0.5, "finger": 1.0}
    assert robot.warnings == ["Moved backwards in time, re-publishing joint transforms!"]


def test_joints_that_the_robot_lacks_take_no_memory() -> None:
    robot = Robot()
    robot.receive(slide=0.25, stranger=1.0)
    assert [*robot._sent_ns] == ["slide"]


def test_fixed_joints_of_an_earlier_description_are_no_part_of_the_robot() -> None:
    robot = Robot()
    robot._set_up(ROBOT.replace("base", "foot"))
    assert [one.child_frame_id for one in robot.still.sent[-1].transforms] == ["foot"]


def test_static_transforms_that_were_sent_before_are_sent_again() -> None:
    robot = Robot()
    other = message("geometry_msgs/msg/TransformStamped", child_frame_id="camera")
    robot._still.sendTransform(other)
    robot._still.sendTransform(other)
    assert [one.child_frame_id for one in robot.still.sent[-1].transforms] == ["base", "camera"]

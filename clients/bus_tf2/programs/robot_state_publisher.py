"""`bus run robot_state_publisher robot_state_publisher`: a robot's links as transforms.

Owns: when and which transforms go out for a state of the joints, the parameters. The robot itself is
`bus_tf2.robot.urdf`.
"""

from pathlib import Path
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.exceptions import ParameterException
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from bus_ros.rclpy.qos_overriding_options import QoSOverridingOptions
from bus_tf2.core.rotation import Transform
from bus_tf2.messages import message, message_type
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.robot.urdf import FIXED, Joint, UrdfError, parse
from bus_tf2.tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

__all__ = ["RobotStatePublisher", "main"]

_NAME = "robot_state_publisher"
_NO_MODEL = "Unable to initialize urdf::model from robot description"


class RobotStatePublisher(Node):
    """Hears `joint_states`; sends `/tf`, `/tf_static` and `robot_description`.

    Raises ValueError for parameters that don't fit, with a text for its user.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(_NAME, **options)
        try:
            self._begin()
        except BaseException:
            self.destroy_node()
            raise

    def _begin(self) -> None:
        description = self.declare_parameter("robot_description", "").value
        if not description:
            raise ValueError("robot_description parameter must not be empty")
        self._frequency = self.declare_parameter("publish_frequency", 20.0).value
        if not 0.0 < self._frequency <= 1000.0:
            raise ValueError("publish_frequency must be between 0 (exclusive) and 1000")
        self._prefix = self.declare_parameter("frame_prefix", "").value
        self._ignores_stamps = self.declare_parameter("ignore_timestamp", False).value
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._describe = self.create_publisher(
            message_type("std_msgs/msg/String"), "robot_description", latched
        )
        self._moving = TransformBroadcaster(self)
        self._still = StaticTransformBroadcaster(self)
        self._last_heard_ns = 0
        self._sent_ns: dict[str, int] = {}
        self._set_up(description)
        self.add_on_set_parameters_callback(self._judge)
        self.add_post_set_parameters_callback(self._take)
        self.create_subscription(
            message_type("sensor_msgs/msg/JointState"),
            "joint_states",
            self._on_joint_states,
            qos_profile_sensor_data,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _set_up(self, description: str) -> None:
        joints = _joints(description)
        self._joints = {joint.name: joint for joint in joints if joint.kind not in (*FIXED, "floating")}
        self._describe.publish(message("std_msgs/msg/String", data=description))
        self.get_logger().info("Robot initialized")
        now = self.get_clock().now().to_msg()
        still = [self._stamped(joint, joint.pose(0.0), now) for joint in joints if joint.kind in FIXED]
        # Joints of an earlier description are no part of this robot.
        self._still.net_message.transforms = []
        self._still.sendTransform(still)

    def _stamped(self, joint: Joint, place: Transform, stamp: Any) -> Any:
        made = message("geometry_msgs/msg/TransformStamped", child_frame_id=self._prefix + joint.child)
        made.header.frame_id, made.header.stamp = self._prefix + joint.parent, stamp
        moved, turned = made.transform.translation, made.transform.rotation
        (moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w) = place
        return made

    def _on_joint_states(self, state: Any) -> None:
        if len(state.name) != len(state.position):
            if state.position:
                self.get_logger().error("Robot state publisher ignored an invalid JointState message")
            else:
                self.get_logger().warning(
                    "Robot state publisher ignored a JointState message about joint(s) "
                    f'"{state.name[0]}"(,...) whose position member was empty.'
                )
            return
        if self._is_due(state):
            positions = dict(zip(state.name, state.position, strict=True))
            for joint in self._joints.values():
                if joint.mimic is not None and joint.mimic.joint in positions:
                    position = positions[joint.mimic.joint] * joint.mimic.multiplier + joint.mimic.offset
                    positions.setdefault(joint.name, position)
            found = [
                self._stamped(self._joints[name], self._joints[name].pose(position), state.header.stamp)
                for name, position in sorted(positions.items())
                if name in self._joints
            ]
            if found:
                self._moving.sendTransform(found)

    def _is_due(self, state: Any) -> bool:
        """Whether one of the joints must be sent again, because it was sent too long ago; then it counts as
        sent.
        """
        now_ns = self.get_clock().now().nanoseconds
        if self._last_heard_ns > now_ns:
            self.get_logger().warning("Moved backwards in time, re-publishing joint transforms!")
            self._sent_ns.clear()
        self._last_heard_ns = now_ns
        stamp_ns = state.header.stamp.sec * 1_000_000_000 + state.header.stamp.nanosec
        last_ns = min((now_ns, *(self._sent_ns.get(name, 0) for name in state.name)))
        due_ns = last_ns + int(1000.0 / self._frequency) * 1_000_000
        if not self._ignores_stamps and stamp_ns < due_ns:
            return False
        # Other joints are ignored, so unknown names in messages take no memory.
        self._sent_ns |= dict.fromkeys((name for name in state.name if name in self._joints), stamp_ns)
        return True

    def _judge(self, parameters: list[Parameter]) -> Any:
        for parameter in parameters:
            reason = ""
            if parameter.name == "robot_description":
                reason = _fault(parameter.value)
            elif parameter.name == "publish_frequency" and not 0.0 < parameter.value <= 1000.0:
                reason = "publish_frequency must be between 0.0 (exclusive) and 1000.0"
            if reason:
                self.get_logger().warning(reason)
                return message("rcl_interfaces/msg/SetParametersResult", successful=False, reason=reason)
        return message("rcl_interfaces/msg/SetParametersResult", successful=True)

    def _take(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            if parameter.name == "publish_frequency":
                self._frequency = parameter.value
            elif parameter.name == "frame_prefix":
                self._prefix = parameter.value
            elif parameter.name == "ignore_timestamp":
                self._ignores_stamps = parameter.value
        for parameter in parameters:
            if parameter.name == "robot_description":
                self._set_up(parameter.value)


def _joints(description: str) -> list[Joint]:
    try:
        return parse(description).joints
    except UrdfError as error:
        raise ValueError(f"{_NO_MODEL}: {error}") from None


def _fault(description: str) -> str:
    if not description:
        return "Empty URDF is not allowed"
    try:
        _joints(description)
    except ValueError as error:
        return str(error)
    return ""


def main() -> int:
    with begun():
        logger = RcutilsLogger(_NAME)
        overrides = []
        if words := own_words():
            logger.warning(
                "No robot_description parameter, but command-line argument available.  Assuming argument "
                "is name "
                "of URDF file.  This backwards compatibility fallback will be removed in the future."
            )
            try:
                text = Path(words[0]).read_text("utf-8")
            except (OSError, UnicodeDecodeError) as error:
                logger.error(
                    f"can't read the URDF file '{words[0]}': {getattr(error, 'strerror', None) or error}"
                )
                return 1
            overrides = [Parameter("robot_description", value=text)]
        try:
            node = RobotStatePublisher(parameter_overrides=overrides)
        except (ValueError, ParameterException) as error:
            logger.fatal(str(error))
            return 1
        rclpy.spin(node)
    return 0

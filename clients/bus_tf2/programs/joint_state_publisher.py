"""`bus run joint_state_publisher joint_state_publisher`: states for joints without another source.

Owns: the positions, from defaults and from other topics, and the time of publishing. The robot itself is
`bus_tf2.robot.urdf`.
"""

from pathlib import Path
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.exceptions import ParameterException
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import DurabilityPolicy, QoSProfile
from bus_tf2.messages import message, message_type
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.robot.urdf import Joint, Mimic, Robot, UrdfError, parse

__all__ = ["JointStatePublisher", "main"]

_NAME = "joint_state_publisher"
_DEFAULTS: dict[str, Any] = {
    "publish_default_efforts": False,
    "publish_default_positions": True,
    "publish_default_velocities": False,
    "rate": 10,
    "source_list": [],
    "use_mimic_tags": True,
    "use_smallest_joint_limits": True,
    "delta": 0.0,
}
_FIELDS = ("position", "velocity", "effort")


class JointStatePublisher(Node):
    """Publishes `joint_states` for the robot of `description`, or of the topic `robot_description`.

    Parameters: `zeros.JOINT` sets the first position of a joint. `dependent_joints.JOINT.parent`, `.factor`
    and `.offset` make a joint follow another. `source_list` names the topics with states to take over.
    `delta` is the distance that joints move with each message. Raises ValueError for parameters that don't
    fit, with a text for the user.
    """

    def __init__(self, description: str | None = None, **options: Any) -> None:
        super().__init__(_NAME, automatically_declare_parameters_from_overrides=True, **options)
        try:
            self._begin(description)
        except BaseException:
            self.destroy_node()
            raise

    def _begin(self, description: str | None) -> None:
        for name, default in _DEFAULTS.items():
            if not self.has_parameter(name):
                self.declare_parameter(name, default)
        settings = {name: self.get_parameter(name).value for name in _DEFAULTS}
        self._settings = settings
        if not _number("rate", settings["rate"]) > 0:
            raise ValueError(f"rate is {settings['rate']}; it must be above 0")
        sources = settings["source_list"] or []
        if not isinstance(sources, list) or not all(isinstance(topic, str) for topic in sources):
            raise ValueError(f"source_list is {sources!r}; it must be a list of topics")
        self._zeros = {name: one.value for name, one in self.get_parameters_by_prefix("zeros").items()}
        self._dependent = self._read_dependent()
        self._robot = Robot("", "", [], [])
        self._states: dict[str, dict[str, float]] = {}
        self._limits: dict[str, tuple[float, float]] = {}
        self._directions: dict[str, int] = {}
        if description is None:
            self.get_logger().info(
                "Waiting for robot_description to be published on the robot_description topic..."
            )
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.create_subscription(
                message_type("std_msgs/msg/String"), "robot_description", self._on_description, latched
            )
        else:
            self._set_up(parse(description))
        kind = message_type("sensor_msgs/msg/JointState")
        for topic in sources:
            self.create_subscription(kind, topic, self._on_joint_states, 10)
        self._publisher = self.create_publisher(kind, "joint_states", 10)
        self.create_timer(1.0 / settings["rate"], self._send)

    def _read_dependent(self) -> dict[str, Mimic]:
        parts: dict[str, dict[str, Any]] = {}
        for name, parameter in self.get_parameters_by_prefix("dependent_joints").items():
            joint, _, part = name.rpartition(".")
            if not joint or part not in ("parent", "factor", "offset"):
                raise ValueError(
                    f"Invalid dependent_joint name '{name}' (allowed are JOINT.parent, JOINT.factor, "
                    f"JOINT.offset)"
                )
            parts.setdefault(joint, {})[part] = parameter.value
        if any(not given.get("parent") for given in parts.values()):
            raise ValueError("All dependent_joints must at least have a parent")
        return {
            joint: Mimic(
                str(given["parent"]),
                _number(f"dependent_joints.{joint}.factor", given.get("factor", 1.0)),
                _number(f"dependent_joints.{joint}.offset", given.get("offset", 0.0)),
            )
            for joint, given in parts.items()
        }

    def _on_description(self, text: Any) -> None:
        try:
            self._set_up(parse(text.data))
        except UrdfError as error:
            self.get_logger().warning(f"Invalid robot_description given, ignoring: {error}")

    def _set_up(self, robot: Robot) -> None:
        self._robot = robot
        self._states, self._limits, self._follows = {}, {}, dict(self._dependent)
        self._order: list[str] = []
        for joint in robot.joints:
            if joint.kind in ("fixed", "floating", "planar"):
                continue
            limits = self._limits_of(joint)
            if limits is None:
                self.get_logger().warning(
                    f"{joint.name} is not fixed, nor continuous, but limits are not specified!"
                )
                continue
            self._order.append(joint.name)
            if joint.mimic is not None and self._settings["use_mimic_tags"]:
                self._follows[joint.name] = joint.mimic
            elif joint.name not in self._follows:
                self._limits[joint.name] = limits
                self._states[joint.name] = self._first_state(joint.name, limits)

    def _limits_of(self, joint: Joint) -> tuple[float, float] | None:
        if joint.limits is None or not self._settings["use_smallest_joint_limits"]:
            return joint.limits
        return max(joint.limits[0], joint.soft_limits[0]), min(joint.limits[1], joint.soft_limits[1])

    def _first_state(self, name: str, limits: tuple[float, float]) -> dict[str, float]:
        lower, upper = limits
        middle = (lower + upper) / 2 if lower > 0 or upper < 0 else 0.0
        wanted = {
            "position": ("publish_default_positions", float(self._zeros.get(name, middle))),
            "velocity": ("publish_default_velocities", 0.0),
            "effort": ("publish_default_efforts", 0.0),
        }
        return {field: value for field, (setting, value) in wanted.items() if self._settings[setting]}

    def _on_joint_states(self, state: Any) -> None:
        for index, name in enumerate(state.name):
            known = self._states.get(name)
            for field in _FIELDS if known is not None else ():
                values = getattr(state, field)
                if index < len(values) and known is not None:
                    known[field] = float(values[index])

    def _send(self) -> None:
        if not self._robot.links:
            return
        if self._settings["delta"] > 0:
            self._move(self._settings["delta"])
        made = message("sensor_msgs/msg/JointState", name=list(self._order))
        made.header.stamp = self.get_clock().now().to_msg()
        states = [self._state_of(name) for name in self._order]
        for field in _FIELDS:
            if any(field in state for state in states):
                setattr(made, field, [state.get(field, 0.0) for state in states])
        if states:
            self._publisher.publish(made)

    def _state_of(self, name: str) -> dict[str, float]:
        """The joint's own state, or the state computed from the joint that it follows."""
        factor, offset, seen = 1.0, 0.0, {name}
        while name in self._follows and name not in self._states:
            follows = self._follows[name]
            factor, offset = factor * follows.multiplier, offset + factor * follows.offset
            name = follows.joint
            if name in seen:
                return {}
            seen.add(name)
        state = dict(self._states.get(name, {}))
        if "position" in state:
            state["position"] = state["position"] * factor + offset
        if "velocity" in state:
            state["velocity"] *= factor
        return state

    def _move(self, delta: float) -> None:
        """To and fro between the limits, in steps."""
        for name, state in self._states.items():
            lower, upper = self._limits[name]
            direction = self._directions.get(name, 1)
            position = state.get("position", 0.0) + direction * delta
            if not lower <= position <= upper:
                self._directions[name] = -direction
                position = min(max(position, lower), upper)
            state["position"] = position


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} is {value!r}; it must be a number")
    return float(value)


def main() -> int:
    with begun():
        logger = RcutilsLogger(_NAME)
        words, description = own_words(), None
        try:
            if words:
                description = Path(words[0]).read_text("utf-8")
            node = JointStatePublisher(description)
        except (OSError, UnicodeDecodeError) as error:
            logger.error(
                f"can't read the URDF file '{words[0]}': {getattr(error, 'strerror', None) or error}"
            )
            return 1
        except (ValueError, ParameterException) as error:
            logger.fatal(str(error))
            return 1
        rclpy.spin(node)
    return 0

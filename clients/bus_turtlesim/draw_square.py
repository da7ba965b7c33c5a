"""`bus run turtlesim draw_square`: turtle1 draws a square, side by side.

Owns: the way round the square (`Square`, pure), and its node.
"""

from contextlib import suppress
from enum import Enum
from math import cos, pi, sin
from typing import Any, NamedTuple

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.node import Node
from bus_turtlesim.messages import Empty, Pose, Twist
from bus_turtlesim.world import are_finite

__all__ = ["DrawSquare", "Place", "Square", "main"]

_SIDE = 2.0
_PERIOD_S = 0.016


class Place(NamedTuple):
    """The present or wanted pose of a turtle: m, and rad from -pi to pi."""

    x: float
    y: float
    theta: float

    def is_near(self, other: "Place") -> bool:
        return (
            abs(self.x - other.x) < 0.1
            and abs(self.y - other.y) < 0.1
            and abs(self.theta - other.theta) < 0.01
        )


class _State(Enum):
    FORWARD = 0
    STOP_FORWARD = 1
    TURN = 2
    STOP_TURN = 3


class Square:
    """The next action on the way round; the way never ends."""

    def __init__(self) -> None:
        self._state = _State.FORWARD
        self._goal: Place | None = None

    def next(self, place: Place, is_still: bool) -> tuple[float, float, list[str]]:
        """The forward velocity and the turn to send now, and the text to log."""
        said = []
        if self._goal is None:
            said.append(self._aim(_ahead(place)))
        assert self._goal is not None
        if self._state in (_State.FORWARD, _State.TURN):
            if not place.is_near(self._goal):
                return (1.0, 0.0, said) if self._state is _State.FORWARD else (0.0, 0.4, said)
            self._state = _State.STOP_FORWARD if self._state is _State.FORWARD else _State.STOP_TURN
        elif is_still:
            said.append("Reached goal")
            if self._state is _State.STOP_FORWARD:
                self._state = _State.TURN
                said.append(self._aim(_to_the_left(place)))
            else:
                self._state = _State.FORWARD
                said.append(self._aim(_ahead(place)))
        return 0.0, 0.0, said

    def _aim(self, goal: Place) -> str:
        self._goal = goal
        return f"New goal [{goal.x:f} {goal.y:f}, {goal.theta:f}]"


def _ahead(place: Place) -> Place:
    return Place(place.x + cos(place.theta) * _SIDE, place.y + sin(place.theta) * _SIDE, place.theta)


def _to_the_left(place: Place) -> Place:
    theta = place.theta + pi / 2
    return place._replace(theta=theta - 2 * pi if theta >= pi else theta)


class DrawSquare(Node):
    """The node: begins with a reset of turtlesim."""

    def __init__(self, **options: Any) -> None:
        super().__init__("draw_square", **options)
        self._square = Square()
        self._pose: Any = None
        self._commands = self.create_publisher(Twist, "turtle1/cmd_vel", 1)
        self.create_subscription(Pose, "turtle1/pose", self._on_pose, 1)
        self._reset = self.create_client(Empty, "reset")
        self._is_reset = False
        self.create_timer(_PERIOD_S, self._step)

    def _on_pose(self, pose: Any) -> None:
        if are_finite(pose.x, pose.y, pose.theta):
            self._pose = pose

    def _step(self) -> None:
        if not self._is_reset:
            if self._reset.service_is_ready():
                self._reset.call_async(Empty.Request())
                self._is_reset, self._pose = True, None
            return
        pose = self._pose
        if pose is None:
            return
        is_still = abs(pose.linear_velocity) < 0.0001 and abs(pose.angular_velocity) < 0.0001
        forward, turn, said = self._square.next(Place(pose.x, pose.y, pose.theta), is_still)
        for line in said:
            self.get_logger().info(line)
        twist = Twist()
        twist.linear.x, twist.angular.z = forward, turn
        self._commands.publish(twist)


def main() -> int:
    with rclpy.init(), suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(DrawSquare())
    return 0

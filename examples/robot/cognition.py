"""Cognition: finds the ball in the image, follows it between images with the IMU, and drives after it."""

from math import atan2, copysign, pi, sqrt
from typing import NamedTuple

import bus
from bus.msg.geometry_msgs import Twist, Vector3
from bus.msg.sensor_msgs import Image, Imu, JointState
from common import (
    BALL_RADIUS_M,
    BOUNDS,
    CAMERA,
    COMMAND,
    FOCAL_PX,
    IMU,
    JOINTS,
    WHEEL_RADIUS_M,
    clamp,
    seconds_of,
)

_IS_BRIGHT = bytes(value >= 200 for value in range(256))
_LEAST_PIXELS = 20
_KEEP_AWAY_M = 1.0
_SEARCH_RAD_S = 0.8
_LARGEST_STEP_M_S = 0.2


class Ball(NamedTuple):
    """The position of the ball as seen from the camera."""

    bearing_rad: float
    distance_m: float


def find_ball(image: Image) -> Ball | None:
    """Find the ball by the centroid and the number of bright red pixels."""
    width, height = image.width, image.height
    if image.encoding != "rgb8" or not 0 < 3 * width * height == len(image.data):
        return None
    bright = image.data[0::3].translate(_IS_BRIGHT)
    first, last = bright.find(1) // width, bright.rfind(1) // width
    band = bright[first * width : (last + 1) * width]
    columns = [band[column::width].count(1) for column in range(width)]
    area = sum(columns)
    if area < _LEAST_PIXELS:
        return None
    centre = sum(column * count for column, count in enumerate(columns)) / area
    return Ball(atan2(width / 2 - centre, FOCAL_PX), FOCAL_PX * BALL_RADIUS_M / sqrt(area / pi))


class Driver:
    """Estimates the position of the ball, and computes commands to reach it."""

    def __init__(self) -> None:
        self._bearing_rad = 0.0
        self._yaw_rate = 0.0
        self._speed = 0.0
        self._turned_s: float | None = None

    def turn(self, imu: Imu) -> None:
        """Update the ball's bearing: between two images, it moves opposite to the robot's turn."""
        self._yaw_rate = imu.angular_velocity.z
        now_s = seconds_of(imu.header.stamp)
        if self._turned_s is not None:
            self._bearing_rad -= self._yaw_rate * clamp(now_s - self._turned_s, 0.0, 0.1)
        self._turned_s = now_s

    def roll(self, joints: JointState) -> None:
        if joints.velocity:
            self._speed = WHEEL_RADIUS_M * sum(joints.velocity) / len(joints.velocity)

    def decide(self, ball: Ball | None) -> Twist:
        """The next command: towards the ball, or a turn until it comes into view."""
        if ball is None:
            return Twist(angular=Vector3(z=copysign(_SEARCH_RAD_S, self._bearing_rad)))
        # The gyroscope is fast and drifts, the camera is slow and does not drift: each corrects the other.
        self._bearing_rad += 0.5 * (ball.bearing_rad - self._bearing_rad)
        speed = clamp(
            0.8 * (ball.distance_m - _KEEP_AWAY_M),
            self._speed - _LARGEST_STEP_M_S,
            self._speed + _LARGEST_STEP_M_S,
        )
        turn = 2.5 * self._bearing_rad - 0.2 * self._yaw_rate
        return Twist(
            linear=Vector3(x=clamp(speed, *BOUNDS["linear.x"])),
            angular=Vector3(z=clamp(turn, *BOUNDS["angular.z"])),
        )


async def main() -> None:
    driver = Driver()
    async with bus.Node("cognition") as node:
        commands = await node.create_publisher(COMMAND.type, COMMAND.name, COMMAND.qos)

        def see(image: Image) -> None:
            commands.publish(driver.decide(find_ball(image)))

        await node.create_subscription(IMU.type, IMU.name, IMU.qos, driver.turn)
        await node.create_subscription(JOINTS.type, JOINTS.name, JOINTS.qos, driver.roll)
        await node.create_subscription(CAMERA.type, CAMERA.name, CAMERA.qos, see)
        await node.spin()


if __name__ == "__main__":
    bus.run(main())

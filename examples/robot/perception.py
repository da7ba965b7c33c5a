"""Perception: simulates a camera, an IMU and wheel encoders. The robot moves as actuation commands."""

from math import cos, sin
from random import gauss
from time import monotonic

import bus
from bus.msg.geometry_msgs import Quaternion, Twist, Vector3
from bus.msg.sensor_msgs import Image, Imu, JointState
from bus.msg.std_msgs import Header
from common import APPLIED, CAMERA, COMMAND_TIMEOUT_S, HEIGHT, IMU, JOINTS, WIDTH, now
from world import World


class Body:
    """The simulated world, kept at the present time."""

    def __init__(self) -> None:
        self.world = World()
        self._command = Twist()
        self._now_s = self._commanded_s = monotonic()

    def obey(self, command: Twist) -> None:
        self._command, self._commanded_s = command, monotonic()

    def advance(self) -> None:
        before, self._now_s = self._now_s, monotonic()
        if self._now_s - self._commanded_s > COMMAND_TIMEOUT_S:
            self._command = Twist()
        self.world.advance(self._now_s - before, self._command.linear.x, self._command.angular.z)

    def image(self) -> Image:
        header = Header(stamp=now(), frame_id="camera")
        return Image(
            header=header,
            height=HEIGHT,
            width=WIDTH,
            encoding="rgb8",
            step=3 * WIDTH,
            data=self.world.picture(),
        )

    def imu(self) -> Imu:
        world = self.world
        return Imu(
            header=Header(stamp=now(), frame_id="imu"),
            orientation=Quaternion(z=sin(world.heading / 2), w=cos(world.heading / 2)),
            angular_velocity=Vector3(x=gauss(0, 0.01), y=gauss(0, 0.01), z=world.yaw_rate + gauss(0, 0.01)),
            linear_acceleration=Vector3(
                x=world.acceleration + gauss(0, 0.05),
                y=world.speed * world.yaw_rate + gauss(0, 0.05),
                z=9.81 + gauss(0, 0.05),
            ),
        )

    def joints(self) -> JointState:
        return JointState(
            header=Header(stamp=now()),
            name=["left_wheel", "right_wheel"],
            position=self.world.wheels,
            velocity=list(self.world.wheel_rates()),
        )


async def main() -> None:
    body = Body()
    async with bus.Node("perception") as node:
        camera = await node.create_publisher(CAMERA.type, CAMERA.name, CAMERA.qos)
        imu = await node.create_publisher(IMU.type, IMU.name, IMU.qos)
        joints = await node.create_publisher(JOINTS.type, JOINTS.name, JOINTS.qos)
        await node.create_subscription(APPLIED.type, APPLIED.name, APPLIED.qos, body.obey)

        def feel() -> None:
            body.advance()
            imu.publish(body.imu())

        node.create_timer(1 / IMU.rate_hz, feel)
        node.create_timer(1 / JOINTS.rate_hz, lambda: joints.publish(body.joints()))
        node.create_timer(1 / CAMERA.rate_hz, lambda: camera.publish(body.image()))
        await node.spin()


if __name__ == "__main__":
    bus.run(main())

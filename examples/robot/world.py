"""The simulation: a robot on two wheels, a ball that rolls around, and the image of a camera.

SI units; x points ahead, angles count to the left, in radians.
"""

import random
from math import atan2, cos, dist, exp, isqrt, pi, remainder, sin, tan

from common import BALL_RADIUS_M, FOCAL_PX, HEIGHT, TRACK_M, WHEEL_RADIUS_M, WIDTH

_MOTOR_LAG_S = 0.1
_DARK = bytes(value % 64 for value in range(256))
_NOISE = random.randbytes(2 * 3 * WIDTH * HEIGHT).translate(_DARK)
_ORANGE = b"\xff\x80\x10"


class World:
    """The state of robot and ball at `time_s`."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.x = self.y = self.heading = 0.0
        self.speed = self.yaw_rate = self.acceleration = 0.0
        self.wheels = [0.0, 0.0]
        """Angles by which the left and the right wheel have turned."""

    def advance(self, dt: float, speed: float, yaw_rate: float) -> None:
        """Advance by `dt` seconds while the motors get `speed` and `yaw_rate`."""
        reached = 1 - exp(-dt / _MOTOR_LAG_S)
        self.acceleration = (speed - self.speed) * reached / dt
        self.speed += (speed - self.speed) * reached
        self.yaw_rate += (yaw_rate - self.yaw_rate) * reached
        self.heading += self.yaw_rate * dt
        self.x += self.speed * cos(self.heading) * dt
        self.y += self.speed * sin(self.heading) * dt
        self.wheels = [at + rate * dt for at, rate in zip(self.wheels, self.wheel_rates(), strict=True)]
        self.time_s += dt

    def wheel_rates(self) -> tuple[float, float]:
        """Turn rates of the left and the right wheel."""
        turn = self.yaw_rate * TRACK_M / 2
        return (self.speed - turn) / WHEEL_RADIUS_M, (self.speed + turn) / WHEEL_RADIUS_M

    def ball(self) -> tuple[float, float]:
        """The position of the ball, on its way around an ellipse."""
        return 2.5 + cos(0.3 * self.time_s), 1.5 * sin(0.3 * self.time_s)

    def picture(self) -> bytes:
        """The camera's image as rgb8: noise, and the ball at its place in the lens."""
        start = 3 * random.randrange(WIDTH * HEIGHT)
        pixels = bytearray(_NOISE[start : start + 3 * WIDTH * HEIGHT])
        east, north = self.ball()
        bearing = remainder(atan2(north - self.y, east - self.x) - self.heading, 2 * pi)
        distance = dist((self.x, self.y), (east, north))
        if abs(bearing) < pi / 3 and distance > 2 * BALL_RADIUS_M:
            column = round(WIDTH / 2 - FOCAL_PX * tan(bearing))
            _paint_disc(pixels, column, HEIGHT // 2, round(FOCAL_PX * BALL_RADIUS_M / distance))
        return bytes(pixels)


def _paint_disc(pixels: bytearray, column: int, row: int, radius: int) -> None:
    for offset in range(max(-radius, -row), min(radius + 1, HEIGHT - row)):
        half = isqrt(radius**2 - offset**2)
        left, right = max(column - half, 0), min(column + half + 1, WIDTH)
        if left < right:
            start = (row + offset) * WIDTH
            pixels[3 * (start + left) : 3 * (start + right)] = _ORANGE * (right - left)

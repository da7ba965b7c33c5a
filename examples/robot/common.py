"""Shared definitions of the robot's layers: topics, rates, bounds, measures."""

from time import time_ns
from typing import Generic, NamedTuple, TypeVar

import msgspec

import bus
from bus.msg.builtin_interfaces import Time
from bus.msg.geometry_msgs import Twist
from bus.msg.sensor_msgs import Image, Imu, JointState

M = TypeVar("M", bound=msgspec.Struct)


class Topic(NamedTuple, Generic[M]):
    """A topic of the robot, and its rate."""

    name: str
    type: type[M]
    rate_hz: float
    qos: bus.QoSProfile


CAMERA = Topic("/camera/image_raw", Image, 30.0, bus.qos.sensor_data)
IMU = Topic("/imu/data", Imu, 200.0, bus.qos.sensor_data)
JOINTS = Topic("/joint_states", JointState, 100.0, bus.qos.sensor_data)
# Only the newest command counts.
COMMAND = Topic("/cmd_vel", Twist, CAMERA.rate_hz, bus.QoSProfile(depth=1))
APPLIED = Topic("/cmd_vel_applied", Twist, CAMERA.rate_hz, bus.QoSProfile(depth=1))
TOPICS: tuple[Topic[Image] | Topic[Imu] | Topic[JointState] | Topic[Twist], ...] = (
    CAMERA,
    IMU,
    JOINTS,
    COMMAND,
    APPLIED,
)

COMMAND_TIMEOUT_S = 0.5
"""The robot stops after this time without commands."""

BOUNDS = {"linear.x": (-0.5, 1.0), "angular.z": (-2.0, 2.0)}
"""The range of the motors in m/s and rad/s; every other field of a command must be 0."""

WHEEL_RADIUS_M = 0.1
TRACK_M = 0.4
BALL_RADIUS_M = 0.15

WIDTH, HEIGHT = 640, 480
FOCAL_PX = 554.0
"""Focal length of a lens with a horizontal field of view of 60 degrees."""


class TopicHealth(msgspec.Struct, frozen=True):
    """Figures of one topic since monitoring's last report."""

    topic: str
    nominal_hz: float
    window_s: float
    published: int
    received: int
    age_s: float | None
    """Mean time from publish to reception; None without messages."""
    age_max_s: float | None
    stamp_age_s: float | None
    """Mean time from header.stamp, the time of the measurement, to reception; None without a header."""
    lost: dict[str, int]
    """Messages lost by all nodes since the start, by "node: reason"."""


class Health(msgspec.Struct, frozen=True):
    """Monitoring's report on all topics."""

    topics: list[TopicHealth]


HEALTH_TOPIC = "/health"


def now() -> Time:
    """The time of the wall clock, as a stamp."""
    sec, nanosec = divmod(time_ns(), 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def seconds_of(stamp: Time) -> float:
    return stamp.sec + stamp.nanosec / 1e9


def clamp(value: float, low: float, high: float) -> float:
    return max(low, min(value, high))

"""geometry_msgs of ROS 2 Jazzy: points, poses, velocities, forces. Units are SI.

Made by `make messages`.
"""

from msgspec import field

from bus.msg._types import Message, float32, float64, float64_36, int64, string, zeros
from bus.msg.std_msgs import Header

__all__ = [
    "Accel",
    "AccelStamped",
    "AccelWithCovariance",
    "AccelWithCovarianceStamped",
    "Inertia",
    "InertiaStamped",
    "Point",
    "Point32",
    "PointStamped",
    "Polygon",
    "PolygonInstance",
    "PolygonInstanceStamped",
    "PolygonStamped",
    "Pose",
    "Pose2D",
    "PoseArray",
    "PoseStamped",
    "PoseWithCovariance",
    "PoseWithCovarianceStamped",
    "Quaternion",
    "QuaternionStamped",
    "Transform",
    "TransformStamped",
    "Twist",
    "TwistStamped",
    "TwistWithCovariance",
    "TwistWithCovarianceStamped",
    "Vector3",
    "Vector3Stamped",
    "VelocityStamped",
    "Wrench",
    "WrenchStamped",
]


class Vector3(Message, kw_only=True):
    """A direction with a length in free space."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


class Accel(Message, kw_only=True):
    """An acceleration: linear in m/s², angular in rad/s²."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


class AccelStamped(Message, kw_only=True):
    """An Accel with time and frame."""

    header: Header = field(default_factory=Header)
    accel: Accel = field(default_factory=Accel)


class AccelWithCovariance(Message, kw_only=True):
    """An Accel with its uncertainty: 6x6, row by row, over x, y, z and the turns about X, Y, Z."""

    accel: Accel = field(default_factory=Accel)
    covariance: float64_36 = field(default_factory=zeros(36))


class AccelWithCovarianceStamped(Message, kw_only=True):
    """An AccelWithCovariance with time and frame."""

    header: Header = field(default_factory=Header)
    accel: AccelWithCovariance = field(default_factory=AccelWithCovariance)


class Inertia(Message, kw_only=True):
    """Mass in kg, centre of mass in m, and the inertia tensor in kg·m²."""

    m: float64 = 0.0
    com: Vector3 = field(default_factory=Vector3)
    ixx: float64 = 0.0
    ixy: float64 = 0.0
    ixz: float64 = 0.0
    iyy: float64 = 0.0
    iyz: float64 = 0.0
    izz: float64 = 0.0


class InertiaStamped(Message, kw_only=True):
    """An Inertia with time and frame."""

    header: Header = field(default_factory=Header)
    inertia: Inertia = field(default_factory=Inertia)


class Point(Message, kw_only=True):
    """A position in free space."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


class Point32(Message, kw_only=True):
    """A position of single precision, for large sets of points."""

    x: float32 = 0.0
    y: float32 = 0.0
    z: float32 = 0.0


class PointStamped(Message, kw_only=True):
    """A Point with time and frame."""

    header: Header = field(default_factory=Header)
    point: Point = field(default_factory=Point)


class Polygon(Message, kw_only=True):
    """An area, by its corners; the last is joined to the first."""

    points: list[Point32] = field(default_factory=list)


class PolygonInstance(Message, kw_only=True):
    """A Polygon that can be told from others by its number."""

    polygon: Polygon = field(default_factory=Polygon)
    id: int64 = 0


class PolygonInstanceStamped(Message, kw_only=True):
    """A PolygonInstance with time and frame."""

    header: Header = field(default_factory=Header)
    polygon: PolygonInstance = field(default_factory=PolygonInstance)


class PolygonStamped(Message, kw_only=True):
    """A Polygon with time and frame."""

    header: Header = field(default_factory=Header)
    polygon: Polygon = field(default_factory=Polygon)


class Quaternion(Message, kw_only=True):
    """An orientation in free space; the default is no turn."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


class Pose(Message, kw_only=True):
    """A position and an orientation."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


class Pose2D(Message, kw_only=True):
    """A position and an orientation in a plane; deprecated in ROS 2."""

    x: float64 = 0.0
    y: float64 = 0.0
    theta: float64 = 0.0


class PoseArray(Message, kw_only=True):
    """Several poses with one time and frame."""

    header: Header = field(default_factory=Header)
    poses: list[Pose] = field(default_factory=list)


class PoseStamped(Message, kw_only=True):
    """A Pose with time and frame."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


class PoseWithCovariance(Message, kw_only=True):
    """A Pose with its uncertainty: 6x6, row by row, over x, y, z and the turns about X, Y, Z."""

    pose: Pose = field(default_factory=Pose)
    covariance: float64_36 = field(default_factory=zeros(36))


class PoseWithCovarianceStamped(Message, kw_only=True):
    """A PoseWithCovariance with time and frame."""

    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


class QuaternionStamped(Message, kw_only=True):
    """A Quaternion with time and frame."""

    header: Header = field(default_factory=Header)
    quaternion: Quaternion = field(default_factory=Quaternion)


class Transform(Message, kw_only=True):
    """A shift and a turn from one coordinate frame to another."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


class TransformStamped(Message, kw_only=True):
    """The transform from `header.frame_id` to `child_frame_id` at a time."""

    header: Header = field(default_factory=Header)
    child_frame_id: string = ""
    transform: Transform = field(default_factory=Transform)


class Twist(Message, kw_only=True):
    """A velocity: linear in m/s, angular in rad/s."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


class TwistStamped(Message, kw_only=True):
    """A Twist with time and frame."""

    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


class TwistWithCovariance(Message, kw_only=True):
    """A Twist with its uncertainty: 6x6, row by row, over x, y, z and the turns about X, Y, Z."""

    twist: Twist = field(default_factory=Twist)
    covariance: float64_36 = field(default_factory=zeros(36))


class TwistWithCovarianceStamped(Message, kw_only=True):
    """A TwistWithCovariance with time and frame."""

    header: Header = field(default_factory=Header)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


class Vector3Stamped(Message, kw_only=True):
    """A Vector3 with time and frame."""

    header: Header = field(default_factory=Header)
    vector: Vector3 = field(default_factory=Vector3)


class VelocityStamped(Message, kw_only=True):
    """The velocity of one frame, seen from another, in a third."""

    header: Header = field(default_factory=Header)
    body_frame_id: string = ""
    reference_frame_id: string = ""
    velocity: Twist = field(default_factory=Twist)


class Wrench(Message, kw_only=True):
    """Force in N and torque in N·m."""

    force: Vector3 = field(default_factory=Vector3)
    torque: Vector3 = field(default_factory=Vector3)


class WrenchStamped(Message, kw_only=True):
    """A Wrench with time and frame."""

    header: Header = field(default_factory=Header)
    wrench: Wrench = field(default_factory=Wrench)

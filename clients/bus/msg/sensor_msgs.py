"""sensor_msgs of ROS 2 Jazzy: what sensors measure. Units are SI.

Made by `make messages`.
"""

from typing import ClassVar

from msgspec import field

from bus.msg._types import (
    Message,
    float32,
    float64,
    float64_9,
    float64_12,
    int8,
    int32,
    string,
    uint8,
    uint8_array,
    uint16,
    uint32,
    zeros,
)
from bus.msg.builtin_interfaces import Time
from bus.msg.geometry_msgs import Point32, Quaternion, Transform, Twist, Vector3, Wrench
from bus.msg.std_msgs import Header

__all__ = [
    "BatteryState",
    "CameraInfo",
    "ChannelFloat32",
    "CompressedImage",
    "FluidPressure",
    "Illuminance",
    "Image",
    "Imu",
    "JointState",
    "Joy",
    "JoyFeedback",
    "JoyFeedbackArray",
    "LaserEcho",
    "LaserScan",
    "MagneticField",
    "MultiDOFJointState",
    "MultiEchoLaserScan",
    "NavSatFix",
    "NavSatStatus",
    "PointCloud",
    "PointCloud2",
    "PointField",
    "Range",
    "RegionOfInterest",
    "RelativeHumidity",
    "Temperature",
    "TimeReference",
]


class BatteryState(Message, kw_only=True):
    """State of a power supply; NaN where something is not measured."""

    POWER_SUPPLY_STATUS_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_STATUS_CHARGING: ClassVar[int] = 1
    POWER_SUPPLY_STATUS_DISCHARGING: ClassVar[int] = 2
    POWER_SUPPLY_STATUS_NOT_CHARGING: ClassVar[int] = 3
    POWER_SUPPLY_STATUS_FULL: ClassVar[int] = 4
    POWER_SUPPLY_HEALTH_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_HEALTH_GOOD: ClassVar[int] = 1
    POWER_SUPPLY_HEALTH_OVERHEAT: ClassVar[int] = 2
    POWER_SUPPLY_HEALTH_DEAD: ClassVar[int] = 3
    POWER_SUPPLY_HEALTH_OVERVOLTAGE: ClassVar[int] = 4
    POWER_SUPPLY_HEALTH_UNSPEC_FAILURE: ClassVar[int] = 5
    POWER_SUPPLY_HEALTH_COLD: ClassVar[int] = 6
    POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE: ClassVar[int] = 7
    POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE: ClassVar[int] = 8
    POWER_SUPPLY_TECHNOLOGY_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_TECHNOLOGY_NIMH: ClassVar[int] = 1
    POWER_SUPPLY_TECHNOLOGY_LION: ClassVar[int] = 2
    POWER_SUPPLY_TECHNOLOGY_LIPO: ClassVar[int] = 3
    POWER_SUPPLY_TECHNOLOGY_LIFE: ClassVar[int] = 4
    POWER_SUPPLY_TECHNOLOGY_NICD: ClassVar[int] = 5
    POWER_SUPPLY_TECHNOLOGY_LIMN: ClassVar[int] = 6
    POWER_SUPPLY_TECHNOLOGY_TERNARY: ClassVar[int] = 7
    POWER_SUPPLY_TECHNOLOGY_VRLA: ClassVar[int] = 8

    header: Header = field(default_factory=Header)
    voltage: float32 = 0.0
    temperature: float32 = 0.0
    current: float32 = 0.0
    charge: float32 = 0.0
    capacity: float32 = 0.0
    design_capacity: float32 = 0.0
    percentage: float32 = 0.0
    power_supply_status: uint8 = 0
    power_supply_health: uint8 = 0
    power_supply_technology: uint8 = 0
    present: bool = False
    cell_voltage: list[float32] = field(default_factory=list)
    cell_temperature: list[float32] = field(default_factory=list)
    location: string = ""
    serial_number: string = ""


class RegionOfInterest(Message, kw_only=True):
    """A part of an image, in pixels; all zeros is the whole image."""

    x_offset: uint32 = 0
    y_offset: uint32 = 0
    height: uint32 = 0
    width: uint32 = 0
    do_rectify: bool = False


class CameraInfo(Message, kw_only=True):
    """Calibration of a camera: distortion (d), intrinsics (k), rectification (r), projection (p)."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    distortion_model: string = ""
    d: list[float64] = field(default_factory=list)
    k: float64_9 = field(default_factory=zeros(9))
    r: float64_9 = field(default_factory=zeros(9))
    p: float64_12 = field(default_factory=zeros(12))
    binning_x: uint32 = 0
    binning_y: uint32 = 0
    roi: RegionOfInterest = field(default_factory=RegionOfInterest)


class ChannelFloat32(Message, kw_only=True):
    """One named value for each point of a PointCloud."""

    name: string = ""
    values: list[float32] = field(default_factory=list)


class CompressedImage(Message, kw_only=True):
    """A compressed image; `format` says how (`jpeg`, `png`, ...)."""

    header: Header = field(default_factory=Header)
    format: string = ""
    data: uint8_array = b""


class FluidPressure(Message, kw_only=True):
    """Pressure of air or water, in Pa."""

    header: Header = field(default_factory=Header)
    fluid_pressure: float64 = 0.0
    variance: float64 = 0.0


class Illuminance(Message, kw_only=True):
    """Illuminance as the human eye sees it, in lux."""

    header: Header = field(default_factory=Header)
    illuminance: float64 = 0.0
    variance: float64 = 0.0


class Image(Message, kw_only=True):
    """An uncompressed image: `height` rows of `step` bytes each; `encoding` such as `rgb8`."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    encoding: string = ""
    is_bigendian: uint8 = 0
    step: uint32 = 0
    data: uint8_array = b""


class Imu(Message, kw_only=True):
    """Orientation, turn rate (rad/s) and acceleration (m/s²); covariance -1 first: not measured."""

    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: float64_9 = field(default_factory=zeros(9))
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: float64_9 = field(default_factory=zeros(9))
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: float64_9 = field(default_factory=zeros(9))


class JointState(Message, kw_only=True):
    """Position, velocity and effort of each named joint; an empty list is not measured."""

    header: Header = field(default_factory=Header)
    name: list[string] = field(default_factory=list)
    position: list[float64] = field(default_factory=list)
    velocity: list[float64] = field(default_factory=list)
    effort: list[float64] = field(default_factory=list)


class Joy(Message, kw_only=True):
    """Axes and buttons of a joystick."""

    header: Header = field(default_factory=Header)
    axes: list[float32] = field(default_factory=list)
    buttons: list[int32] = field(default_factory=list)


class JoyFeedback(Message, kw_only=True):
    """One output of a joystick: a light, a rumble or a sound, from 0 to 1."""

    TYPE_LED: ClassVar[int] = 0
    TYPE_RUMBLE: ClassVar[int] = 1
    TYPE_BUZZER: ClassVar[int] = 2

    type: uint8 = 0
    id: uint8 = 0
    intensity: float32 = 0.0


class JoyFeedbackArray(Message, kw_only=True):
    """Several outputs of a joystick at once."""

    array: list[JoyFeedback] = field(default_factory=list)


class LaserEcho(Message, kw_only=True):
    """The distances of all echoes of one beam, in m."""

    echoes: list[float32] = field(default_factory=list)


class LaserScan(Message, kw_only=True):
    """One scan of a planar range finder: angles in rad, distances in m."""

    header: Header = field(default_factory=Header)
    angle_min: float32 = 0.0
    angle_max: float32 = 0.0
    angle_increment: float32 = 0.0
    time_increment: float32 = 0.0
    scan_time: float32 = 0.0
    range_min: float32 = 0.0
    range_max: float32 = 0.0
    ranges: list[float32] = field(default_factory=list)
    intensities: list[float32] = field(default_factory=list)


class MagneticField(Message, kw_only=True):
    """Magnetic field in T, with its 3x3 covariance."""

    header: Header = field(default_factory=Header)
    magnetic_field: Vector3 = field(default_factory=Vector3)
    magnetic_field_covariance: float64_9 = field(default_factory=zeros(9))


class MultiDOFJointState(Message, kw_only=True):
    """State of joints with several degrees of freedom."""

    header: Header = field(default_factory=Header)
    joint_names: list[string] = field(default_factory=list)
    transforms: list[Transform] = field(default_factory=list)
    twist: list[Twist] = field(default_factory=list)
    wrench: list[Wrench] = field(default_factory=list)


class MultiEchoLaserScan(Message, kw_only=True):
    """One scan of a range finder that hears several echoes of a beam."""

    header: Header = field(default_factory=Header)
    angle_min: float32 = 0.0
    angle_max: float32 = 0.0
    angle_increment: float32 = 0.0
    time_increment: float32 = 0.0
    scan_time: float32 = 0.0
    range_min: float32 = 0.0
    range_max: float32 = 0.0
    ranges: list[LaserEcho] = field(default_factory=list)
    intensities: list[LaserEcho] = field(default_factory=list)


class NavSatStatus(Message, kw_only=True):
    """Kind of fix of a satellite receiver, and the services that were used."""

    STATUS_UNKNOWN: ClassVar[int] = -2
    STATUS_NO_FIX: ClassVar[int] = -1
    STATUS_FIX: ClassVar[int] = 0
    STATUS_SBAS_FIX: ClassVar[int] = 1
    STATUS_GBAS_FIX: ClassVar[int] = 2
    SERVICE_UNKNOWN: ClassVar[int] = 0
    SERVICE_GPS: ClassVar[int] = 1
    SERVICE_GLONASS: ClassVar[int] = 2
    SERVICE_COMPASS: ClassVar[int] = 4
    SERVICE_GALILEO: ClassVar[int] = 8

    status: int8 = -2
    service: uint16 = 0


class NavSatFix(Message, kw_only=True):
    """A position by satellite: degrees, and metres above the WGS 84 ellipsoid."""

    COVARIANCE_TYPE_UNKNOWN: ClassVar[int] = 0
    COVARIANCE_TYPE_APPROXIMATED: ClassVar[int] = 1
    COVARIANCE_TYPE_DIAGONAL_KNOWN: ClassVar[int] = 2
    COVARIANCE_TYPE_KNOWN: ClassVar[int] = 3

    header: Header = field(default_factory=Header)
    status: NavSatStatus = field(default_factory=NavSatStatus)
    latitude: float64 = 0.0
    longitude: float64 = 0.0
    altitude: float64 = 0.0
    position_covariance: float64_9 = field(default_factory=zeros(9))
    position_covariance_type: uint8 = 0


class PointCloud(Message, kw_only=True):
    """A set of points with further values for each; PointCloud2 has replaced it."""

    header: Header = field(default_factory=Header)
    points: list[Point32] = field(default_factory=list)
    channels: list[ChannelFloat32] = field(default_factory=list)


class PointField(Message, kw_only=True):
    """Where one field of a point lies in the data of a PointCloud2, and its type."""

    INT8: ClassVar[int] = 1
    UINT8: ClassVar[int] = 2
    INT16: ClassVar[int] = 3
    UINT16: ClassVar[int] = 4
    INT32: ClassVar[int] = 5
    UINT32: ClassVar[int] = 6
    FLOAT32: ClassVar[int] = 7
    FLOAT64: ClassVar[int] = 8

    name: string = ""
    offset: uint32 = 0
    datatype: uint8 = 0
    count: uint32 = 0


class PointCloud2(Message, kw_only=True):
    """A set of points as binary records, laid out as `fields` says."""

    header: Header = field(default_factory=Header)
    height: uint32 = 0
    width: uint32 = 0
    fields: list[PointField] = field(default_factory=list)
    is_bigendian: bool = False
    point_step: uint32 = 0
    row_step: uint32 = 0
    data: uint8_array = b""
    is_dense: bool = False


class Range(Message, kw_only=True):
    """One distance from a sonar or an infrared ranger, in m."""

    ULTRASOUND: ClassVar[int] = 0
    INFRARED: ClassVar[int] = 1

    header: Header = field(default_factory=Header)
    radiation_type: uint8 = 0
    field_of_view: float32 = 0.0
    min_range: float32 = 0.0
    max_range: float32 = 0.0
    range: float32 = 0.0
    variance: float32 = 0.0


class RelativeHumidity(Message, kw_only=True):
    """Relative humidity from 0 to 1."""

    header: Header = field(default_factory=Header)
    relative_humidity: float64 = 0.0
    variance: float64 = 0.0


class Temperature(Message, kw_only=True):
    """Temperature in °C."""

    header: Header = field(default_factory=Header)
    temperature: float64 = 0.0
    variance: float64 = 0.0


class TimeReference(Message, kw_only=True):
    """A time from a source other than the host's clock."""

    header: Header = field(default_factory=Header)
    time_ref: Time = field(default_factory=Time)
    source: string = ""

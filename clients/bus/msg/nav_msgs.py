"""nav_msgs of ROS 2 Jazzy: maps, paths and odometry.

Made by `make messages`.
"""

from msgspec import field

from bus.msg._types import Message, float32, int8, string, uint32
from bus.msg.builtin_interfaces import Time
from bus.msg.geometry_msgs import Point, Pose, PoseStamped, PoseWithCovariance, TwistWithCovariance
from bus.msg.std_msgs import Header

__all__ = [
    "Goals",
    "GridCells",
    "MapMetaData",
    "OccupancyGrid",
    "Odometry",
    "Path",
]


class Goals(Message, kw_only=True):
    """Poses to reach, in order."""

    header: Header = field(default_factory=Header)
    goals: list[PoseStamped] = field(default_factory=list)


class GridCells(Message, kw_only=True):
    """Cells of a grid, by their centres, all of one size."""

    header: Header = field(default_factory=Header)
    cell_width: float32 = 0.0
    cell_height: float32 = 0.0
    cells: list[Point] = field(default_factory=list)


class MapMetaData(Message, kw_only=True):
    """Size, resolution (m per cell) and origin of a map."""

    map_load_time: Time = field(default_factory=Time)
    resolution: float32 = 0.0
    width: uint32 = 0
    height: uint32 = 0
    origin: Pose = field(default_factory=Pose)


class OccupancyGrid(Message, kw_only=True):
    """A map, row by row: chance that a cell is occupied in percent, -1 unknown."""

    header: Header = field(default_factory=Header)
    info: MapMetaData = field(default_factory=MapMetaData)
    data: list[int8] = field(default_factory=list)


class Odometry(Message, kw_only=True):
    """Estimated pose in `header.frame_id` and velocity in `child_frame_id`."""

    header: Header = field(default_factory=Header)
    child_frame_id: string = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


class Path(Message, kw_only=True):
    """Poses to follow, in order."""

    header: Header = field(default_factory=Header)
    poses: list[PoseStamped] = field(default_factory=list)

"""The points of a laser scan. Must not know topics and frames."""

from typing import Any

from bus_ros.extras import extra
from bus_ros.rosidl import message_class
from bus_ros.sensor_msgs_py.point_cloud2 import create_cloud, dtype_from_fields

__all__ = ["LaserProjection"]

_FLOAT32, _INT32 = 7, 5


class LaserProjection:
    """Makes a PointCloud2 from a LaserScan, in the scan's own frame. It has no state."""

    LASER_SCAN_INVALID = -1.0
    LASER_SCAN_MIN_RANGE = -2.0
    LASER_SCAN_MAX_RANGE = -3.0

    class ChannelOption:
        """Fields of a point besides x, y and z; to be joined by `|`."""

        NONE = 0x00
        INTENSITY = 0x01
        """`intensity`, if the scan has intensities."""
        INDEX = 0x02
        """`index`: the index of its range in the scan."""
        DISTANCE = 0x04
        """`distances`: in meters from the laser."""
        TIMESTAMP = 0x08
        """`stamps`: in seconds since the scan began."""
        VIEWPOINT = 0x10
        """`vp_x`, `vp_y`, `vp_z`: zero."""
        DEFAULT = INTENSITY | INDEX

    def projectLaser(
        self, scan_in: Any, range_cutoff: float = -1.0, channel_options: int = ChannelOption.DEFAULT
    ) -> Any:
        """The points with a range of at least the scan's `range_min`, below `range_cutoff` and `range_max`.

        `range_cutoff` is in meters; negative: only `range_max` limits. Raises ValueError if there are too few
        intensities.
        """
        np = extra("numpy", "laser_geometry")
        option = self.ChannelOption
        ranges = np.array(scan_in.ranges, np.float64)
        limit = scan_in.range_max if range_cutoff < 0 else min(range_cutoff, scan_in.range_max)
        kept = np.flatnonzero((ranges >= scan_in.range_min) & (ranges < limit))
        distances, angles = ranges[kept], scan_in.angle_min + kept * scan_in.angle_increment
        columns: dict[str, Any] = {"x": distances * np.cos(angles), "y": distances * np.sin(angles), "z": 0}
        if channel_options & option.INTENSITY and len(scan_in.intensities):
            if len(scan_in.intensities) < len(ranges):
                raise ValueError(
                    f"a scan with {len(ranges)} ranges has {len(scan_in.intensities)} intensities"
                )
            columns["intensity"] = np.array(scan_in.intensities)[kept]
        if channel_options & option.INDEX:
            columns["index"] = kept
        if channel_options & option.DISTANCE:
            columns["distances"] = distances
        if channel_options & option.TIMESTAMP:
            columns["stamps"] = kept * scan_in.time_increment
        if channel_options & option.VIEWPOINT:
            columns.update(vp_x=0, vp_y=0, vp_z=0)
        field: Any = message_class("sensor_msgs/msg/PointField")
        fields = [
            field(name=name, offset=4 * at, datatype=_INT32 if name == "index" else _FLOAT32, count=1)
            for at, name in enumerate(columns)
        ]
        points = np.empty(len(kept), dtype_from_fields(fields))
        for name, values in columns.items():
            points[name] = values
        return create_cloud(scan_in.header, fields, points)

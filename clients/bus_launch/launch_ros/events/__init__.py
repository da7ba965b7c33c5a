"""Events of nodes; programs import it as `launch_ros.events`."""

from bus_launch.launch_ros.events import lifecycle, matchers

__all__ = ["lifecycle", "matchers"]

"""Events of nodes; programs import it as `launch_ros.events`.

`lifecycle.py` has the events of lifecycle nodes, `matchers.py` which nodes an event is for. Names are ROS
2's.

Read first: `lifecycle.py`. Tests: `tests/unit/bus_launch/launch_ros/test_event_handlers.py`.
"""

from bus_launch.launch_ros.events import lifecycle, matchers
from bus_launch.launch_ros.events.matchers import matches_node_name

__all__ = ["lifecycle", "matchers", "matches_node_name"]

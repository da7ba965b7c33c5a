"""`interactive_markers` on the bus: 3D markers that users of RViz drag, and their menus.

    `interactive_marker_server.py`   markers, their clients' feedback, and updates for the clients
    `menu_handler.py`                a menu for markers, with a callback for each entry

Invariants: names, topics and rules are the same as in ROS 2's package of this name. Clients know only
changes that `applyChanges` has published.

Read first: `interactive_marker_server.py`. Tests: `tests/unit/bus_ros/interactive_markers/`,
`tests/system/test_interactive_markers.py`.
"""

from bus_ros.interactive_markers.interactive_marker_server import InteractiveMarkerServer
from bus_ros.interactive_markers.menu_handler import MenuHandler

__all__ = ["InteractiveMarkerServer", "MenuHandler"]

"""Launch files that start nodes; programs import it as `launch_ros`.

    `actions/` (Node) --+-- `programs.py`          which program, and how it is started
                        +-- `parameter_values.py`, `parameter_files.py`   its parameters
                        +-- `namespaces.py`        its name
    `transitions.py` -- lifecycle nodes, asked over the bus
    `loading.py` (`load_requests.py`) -- components, loaded over the bus
    `tags.py` -- parts of tags that several actions have

Invariants: names, arguments and texts are ROS 2's; `launch` knows nothing of this package;
`parameter_values.py` is pure.

Read first: `actions/node.py`. Tests: `tests/unit/bus_launch/launch_ros/`,
`tests/system/test_launch_processes.py`, `tests/system/test_launch_warm.py`.
"""

from bus_launch.launch_ros import (
    actions,
    descriptions,
    event_handlers,
    events,
    substitutions,
    utilities,
)

__all__ = ["actions", "descriptions", "event_handlers", "events", "substitutions", "utilities"]

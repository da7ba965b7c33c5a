"""Actions for nodes; programs import it as `launch_ros.actions`.

`node.py` starts a node, `lifecycle.py` has lifecycle nodes, `settings.py` settings for the nodes that follow,
`components.py` containers and their components.

Invariants: a setting is true until the end of its group; arguments and texts are ROS 2's.

Read first: `node.py`. Tests: `tests/unit/bus_launch/launch_ros/actions/`,
`tests/system/test_launch_processes.py`.
"""

from bus_launch.launch_ros.actions.components import (
    ComposableNodeContainer,
    LoadComposableNodes,
)
from bus_launch.launch_ros.actions.lifecycle import LifecycleNode, LifecycleTransition
from bus_launch.launch_ros.actions.node import Node
from bus_launch.launch_ros.actions.settings import (
    PushROSNamespace,
    PushRosNamespace,
    ROSTimer,
    RosTimer,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
    SetROSLogDir,
    SetUseSimTime,
)

__all__ = [
    "ComposableNodeContainer",
    "LifecycleNode",
    "LifecycleTransition",
    "LoadComposableNodes",
    "Node",
    "PushROSNamespace",
    "PushRosNamespace",
    "ROSTimer",
    "RosTimer",
    "SetParameter",
    "SetParametersFromFile",
    "SetROSLogDir",
    "SetRemap",
    "SetUseSimTime",
]

"""Actions for nodes; programs import it as `launch_ros.actions`."""

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

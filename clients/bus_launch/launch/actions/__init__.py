"""What a launch does; programs import it as `launch.actions`."""

from bus_launch.launch.action import Action
from bus_launch.launch.actions.basic import (
    EmitEvent,
    LogInfo,
    OpaqueCoroutine,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
    UnregisterEventHandler,
)
from bus_launch.launch.actions.execute_process import ExecuteProcess
from bus_launch.launch.actions.process import ExecuteLocal
from bus_launch.launch.actions.scopes import GroupAction, IncludeLaunchDescription
from bus_launch.launch.actions.settings import (
    AppendEnvironmentVariable,
    PopEnvironment,
    PopLaunchConfigurations,
    PrependEnvironmentVariable,
    PushEnvironment,
    PushLaunchConfigurations,
    ResetEnvironment,
    ResetLaunchConfigurations,
    SetEnvironmentVariable,
    SetLaunchConfiguration,
    UnsetEnvironmentVariable,
    UnsetLaunchConfiguration,
)
from bus_launch.launch.argument import DeclareLaunchArgument

__all__ = [
    "Action",
    "AppendEnvironmentVariable",
    "DeclareLaunchArgument",
    "EmitEvent",
    "ExecuteLocal",
    "ExecuteProcess",
    "GroupAction",
    "IncludeLaunchDescription",
    "LogInfo",
    "OpaqueCoroutine",
    "OpaqueFunction",
    "PopEnvironment",
    "PopLaunchConfigurations",
    "PrependEnvironmentVariable",
    "PushEnvironment",
    "PushLaunchConfigurations",
    "RegisterEventHandler",
    "ResetEnvironment",
    "ResetLaunchConfigurations",
    "SetEnvironmentVariable",
    "SetLaunchConfiguration",
    "Shutdown",
    "TimerAction",
    "UnregisterEventHandler",
    "UnsetEnvironmentVariable",
    "UnsetLaunchConfiguration",
]

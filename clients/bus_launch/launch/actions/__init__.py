"""Actions of a launch; programs import them as `launch.actions`.

    `execute_process.py` -> `process.py` (as configured) -> `process_run.py` (its run) -> `process_lines.py`
                                                            `process_state.py` (its states, a table)

`basic.py`, `settings.py` and `scopes.py` have the actions without a process.

Invariants: a process changes its state only by the table of `process_state.py`; `process_run.py` knows no
handlers and no configuration; names, arguments and texts are ROS 2's.

Read first: `process_state.py`. Tests: `tests/unit/bus_launch/launch/actions/`,
`tests/system/test_launch_processes.py`.
"""

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

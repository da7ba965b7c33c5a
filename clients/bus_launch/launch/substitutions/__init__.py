"""Texts that are evaluated on demand; programs import them as `launch.substitutions`.

`values.py`: values of the launch itself; `outside.py`: environment, files, programs, Python expressions;
`boolean.py`: true, false, and a choice by them. A substitution has `perform(context)`, which returns the
text.

Invariants: nothing is evaluated before `perform`; names, `$(...)` names and errors are ROS 2's.

Read first: `values.py`. Tests: `tests/unit/bus_launch/launch/substitutions/`.
"""

from bus_launch.launch.core import SubstitutionFailure, TextSubstitution
from bus_launch.launch.substitutions.boolean import (
    AllSubstitution,
    AndSubstitution,
    AnySubstitution,
    EqualsSubstitution,
    IfElseSubstitution,
    NotEqualsSubstitution,
    NotSubstitution,
    OrSubstitution,
)
from bus_launch.launch.substitutions.outside import (
    Command,
    EnvironmentVariable,
    FileContent,
    FindExecutable,
    PythonExpression,
)
from bus_launch.launch.substitutions.values import (
    AnonName,
    LaunchConfiguration,
    LaunchLogDir,
    LocalSubstitution,
    PathJoinSubstitution,
    PathSubstitution,
    StringJoinSubstitution,
    ThisLaunchFile,
    ThisLaunchFileDir,
)

__all__ = [
    "AllSubstitution",
    "AndSubstitution",
    "AnonName",
    "AnySubstitution",
    "Command",
    "EnvironmentVariable",
    "EqualsSubstitution",
    "FileContent",
    "FindExecutable",
    "IfElseSubstitution",
    "LaunchConfiguration",
    "LaunchLogDir",
    "LocalSubstitution",
    "NotEqualsSubstitution",
    "NotSubstitution",
    "OrSubstitution",
    "PathJoinSubstitution",
    "PathSubstitution",
    "PythonExpression",
    "StringJoinSubstitution",
    "SubstitutionFailure",
    "TextSubstitution",
    "ThisLaunchFile",
    "ThisLaunchFileDir",
]

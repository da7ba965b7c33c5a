"""Types of parameters and remappings, for annotations; programs import it as `launch_ros.parameters_type`."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from bus_launch.launch.core import SomeSubstitutionsType
from bus_launch.launch_ros.descriptions import Parameter, ParameterFile, ParameterValue

__all__ = [
    "EvaluatedParameters",
    "ParameterFile",
    "ParameterValue",
    "Parameters",
    "RemapRules",
    "SomeParameterFile",
    "SomeParameterValue",
    "SomeParameters",
    "SomeParametersDict",
    "SomeRemapRules",
]

SomeParameterFile: TypeAlias = SomeSubstitutionsType | Path | ParameterFile
SomeParameterValue: TypeAlias = Any
SomeParametersDict: TypeAlias = Mapping[Any, Any]
SomeParameters: TypeAlias = Iterable[SomeParameterFile | Parameter | Mapping[Any, Any]]
Parameters: TypeAlias = Sequence[Any]
EvaluatedParameters: TypeAlias = Sequence[Path | dict[str, Any]]
SomeRemapRules: TypeAlias = Iterable[tuple[SomeSubstitutionsType, SomeSubstitutionsType]]
RemapRules: TypeAlias = Sequence[tuple[Any, Any]]

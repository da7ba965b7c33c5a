"""Functions for writers of actions and of tests; programs import it as `launch_ros.utilities`."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bus_launch.launch.core import LaunchContext, perform_substitutions
from bus_launch.launch_ros.namespaces import (
    is_namespace_absolute,
    is_root_namespace,
    make_namespace_absolute,
    prefix_namespace,
)
from bus_launch.launch_ros.parameter_descriptions import Parameter, ParameterFile
from bus_launch.launch_ros.parameter_values import Parameters, evaluated, normalized
from bus_launch.launch_ros.remap_rules import normalize_remap_rule, normalize_remap_rules

__all__ = [
    "evaluate_parameters",
    "is_namespace_absolute",
    "is_root_namespace",
    "make_namespace_absolute",
    "normalize_parameters",
    "normalize_remap_rule",
    "normalize_remap_rules",
    "prefix_namespace",
]


def normalize_parameters(parameters: Iterable[Any]) -> list[Any]:
    """The normal form of a node's list of files, dicts and Parameters, for `evaluate_parameters`.

    Raises TypeError for another value, and for an item that can't be a parameter.
    """
    if isinstance(parameters, str | Mapping) or not isinstance(parameters, Iterable):
        raise TypeError(f"Expecting list of parameters, got {parameters}")
    return [_normalized(one) for one in parameters]


def evaluate_parameters(context: LaunchContext, parameters: Iterable[Any]) -> tuple[Any, ...]:
    """Paths, and dicts of names and values. Lists are tuples, unless a ParameterValue has a type."""
    return tuple(
        one.evaluate(context) if isinstance(one, ParameterFile) else _with_tuples(context, one)
        for one in parameters
    )


def _with_tuples(context: LaunchContext, parameters: Parameters) -> dict[str, Any]:
    found = evaluated(context, parameters)
    for subs, parameter in parameters:
        name = perform_substitutions(context, subs)
        if isinstance(found[name], list) and parameter.value_type is None:
            found[name] = tuple(found[name])
    return found


def _normalized(one: Any) -> Any:
    if isinstance(one, Mapping):
        return normalized(one)
    if isinstance(one, Parameter):
        return normalized({tuple(one.name): one.typed_value})
    if isinstance(one, ParameterFile):
        return one
    return ParameterFile(str(one) if isinstance(one, Path) else one)

"""Requests to a container: a component's description, as fields of composition_interfaces/srv/LoadNode."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from bus.parameters.file import overrides, parse_file
from bus_launch.launch.core import LaunchContext, perform_substitutions
from bus_launch.launch_ros.descriptions import ComposableNode
from bus_launch.launch_ros.namespaces import make_namespace_absolute, prefix_namespace
from bus_launch.launch_ros.parameter_descriptions import ParameterFile
from bus_launch.launch_ros.parameter_files import text_of
from bus_launch.launch_ros.parameter_values import evaluated

__all__ = ["LoadRequest", "make_request"]

_UNNAMED = "node_name_unspecified"


class LoadRequest(NamedTuple):
    """Parameters and extra arguments are values by name."""

    package_name: str
    plugin_name: str
    node_name: str
    node_namespace: str
    remap_rules: list[str]
    parameters: dict[str, Any]
    extra_arguments: dict[str, Any]


def make_request(description: ComposableNode, context: LaunchContext) -> LoadRequest | None:
    """The request for a component, with the settings for all nodes (`SetParameter`, `SetRemap`,
    `PushROSNamespace`). None if its condition is false.

    As in ROS 2, parameter files apply to the name in the description: without one, only sections for any node
    do. Raises TypeError for an impossible parameter, ConfigurationError for an unusable file.
    """
    condition = description.condition()
    if condition is not None and not condition.evaluate(context):
        return None
    configurations = context.launch_configurations
    name = _text(context, description.node_name)
    own = None if description.node_namespace is None else _text(context, description.node_namespace)
    namespace = make_namespace_absolute(prefix_namespace(configurations.get("ros_namespace"), own))
    full_name = f"{namespace.rstrip('/')}/{name or _UNNAMED}"
    rules = [*configurations.get("ros_remaps", []), *(description.remappings or ())]
    parameters = [*configurations.get("global_params", []), *(description.parameters or ())]
    return LoadRequest(
        package_name=_text(context, description.package),
        plugin_name=_text(context, description.node_plugin),
        node_name=name,
        node_namespace=namespace,
        remap_rules=[f"{_text(context, old)}:={_text(context, new)}" for old, new in rules],
        parameters=_values(context, parameters, full_name),
        extra_arguments=_values(context, description.extra_arguments or (), full_name),
    )


def _text(context: LaunchContext, subs: Any) -> str:
    return "" if subs is None else perform_substitutions(context, subs)


def _values(context: LaunchContext, parameters: Iterable[Any], full_name: str) -> dict[str, Any]:
    """Values of dicts and files. Later ones take precedence."""
    found: dict[str, Any] = {}
    for one in parameters:
        if not isinstance(one, ParameterFile):
            found |= evaluated(context, one)
            continue
        text = text_of(context, one)
        if text is not None:
            found |= overrides(parse_file(text, str(one.evaluate(context))), full_name)
    return found

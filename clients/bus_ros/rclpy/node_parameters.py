"""The methods of a node of the facade that are about parameters; they are those of `NodeParameters`."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.parameters import NodeParameters

__all__ = ["ParameterMethods"]


class ParameterMethods:
    """Base of Node; each method does and raises what the one of NodeParameters says."""

    _parameters: NodeParameters

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        return self._parameters.declare_parameter(name, value, descriptor, ignore_override)

    def declare_parameters(
        self, namespace: str, parameters: Iterable[Sequence[Any]], ignore_override: bool = False
    ) -> list[Parameter]:
        return self._parameters.declare_parameters(namespace, parameters, ignore_override)

    def undeclare_parameter(self, name: str) -> None:
        self._parameters.undeclare_parameter(name)

    def has_parameter(self, name: str) -> bool:
        return self._parameters.has_parameter(name)

    def get_parameter(self, name: str) -> Parameter:
        return self._parameters.get_parameter(name)

    def get_parameters(self, names: Iterable[str]) -> list[Parameter]:
        return self._parameters.get_parameters(names)

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        return self._parameters.get_parameter_or(name, alternative_value)

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        return self._parameters.get_parameters_by_prefix(prefix)

    def get_parameter_type(self, name: str) -> Parameter.Type:
        return self._parameters.get_parameter_type(name)

    def get_parameter_types(self, names: Iterable[str]) -> list[Parameter.Type]:
        return self._parameters.get_parameter_types(names)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        return self._parameters.list_parameters(prefixes, depth)

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        return self._parameters.set_parameters(parameter_list)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        return self._parameters.set_parameters_atomically(parameter_list)

    def describe_parameter(self, name: str) -> Any:
        return self._parameters.describe_parameter(name)

    def describe_parameters(self, names: Iterable[str]) -> list[Any]:
        return self._parameters.describe_parameters(names)

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        return self._parameters.set_descriptor(name, descriptor, alternative_value)

    def add_pre_set_parameters_callback(self, callback: Callable[[list[Parameter]], list[Parameter]]) -> None:
        self._parameters.add_pre_set_parameters_callback(callback)

    def add_on_set_parameters_callback(self, callback: Callable[[list[Parameter]], Any]) -> None:
        self._parameters.add_on_set_parameters_callback(callback)

    def add_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None:
        self._parameters.add_post_set_parameters_callback(callback)

    def remove_pre_set_parameters_callback(self, callback: Callable[..., Any]) -> None:
        self._parameters.remove_pre_set_parameters_callback(callback)

    def remove_on_set_parameters_callback(self, callback: Callable[..., Any]) -> None:
        self._parameters.remove_on_set_parameters_callback(callback)

    def remove_post_set_parameters_callback(self, callback: Callable[..., Any]) -> None:
        self._parameters.remove_post_set_parameters_callback(callback)

"""The six services by which other programs read and change a node's parameters.

Owns: conversion of requests to calls of the node, and of results to responses. Must not know: the storage of
parameters, the transport of services. A wrong request from another program gets an answer, never an error
here.
"""

from collections.abc import Callable, Iterable
from typing import Any

from bus.parameters.messages import SERVICES
from bus.parameters.values import ParameterType as ValueType
from bus_ros.rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rclpy.qos import qos_profile_parameters

__all__ = ["ParameterService"]

_Callback = Callable[[Any, Any], Any]


class ParameterService:
    """Serves the parameters of `node`: `<node>/get_parameters` and its five neighbours."""

    def __init__(self, node: Any, *, callback_group: Any = None) -> None:
        from bus_ros.rosidl import service_class

        self._node = node
        callbacks: dict[str, _Callback] = {
            "DescribeParameters": self._describe,
            "GetParameterTypes": self._get_types,
            "GetParameters": self._get,
            "ListParameters": self._list,
            "SetParameters": self._set,
            "SetParametersAtomically": self._set_atomically,
        }
        self.services = [
            node.create_service(
                service_class(f"rcl_interfaces/srv/{name}"),
                f"{node.get_name()}/{topic}",
                callbacks[name],
                qos_profile=qos_profile_parameters,
                callback_group=callback_group,
            )
            for name, topic in SERVICES.items()
        ]

    def _describe(self, request: Any, response: Any) -> Any:
        for name in request.names:
            try:
                descriptor = self._node.describe_parameter(name)
            except ParameterNotDeclaredException:
                descriptor = parameter_message("ParameterDescriptor")()
            response.descriptors.append(descriptor)
        return response

    def _get_types(self, request: Any, response: Any) -> Any:
        for name in request.names:
            try:
                type_ = self._node.get_parameter_type(name)
            except ParameterNotDeclaredException:
                type_ = ValueType.NOT_SET
            response.types.append(int(type_))
        return response

    def _get(self, request: Any, response: Any) -> Any:
        for name in request.names:
            try:
                value = self._node.get_parameter(name).get_parameter_value()
            except (ParameterNotDeclaredException, ParameterUninitializedException):
                value = parameter_message("ParameterValue")()
            response.values.append(value)
        return response

    def _list(self, request: Any, response: Any) -> Any:
        response.result = self._node.list_parameters(list(request.prefixes), request.depth)
        return response

    def _set(self, request: Any, response: Any) -> Any:
        for parameter in request.parameters:
            response.results.append(self._try_to_set([parameter]))
        return response

    def _set_atomically(self, request: Any, response: Any) -> Any:
        response.result = self._try_to_set(request.parameters)
        return response

    def _try_to_set(self, messages: Iterable[Any]) -> Any:
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
        except (RuntimeError, TypeError, ValueError) as error:
            return _refused(error)
        try:
            return self._node.set_parameters_atomically(parameters)
        except ParameterNotDeclaredException as error:
            return _refused(error)


def _refused(error: Exception) -> Any:
    return parameter_message("SetParametersResult")(successful=False, reason=str(error))

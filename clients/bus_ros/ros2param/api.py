"""`ros2param.api`: reads and changes the parameters of another node, and waits for the answer.

The calls spin `node`. They also work in a callback of another node.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import (
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)
from bus_ros.rclpy.parameter_client import AsyncParameterClient
from bus_ros.rclpy.task import Future

__all__ = [
    "call_describe_parameters",
    "call_get_parameters",
    "call_list_parameters",
    "call_set_parameters",
    "get_parameter_type_string",
    "get_parameter_value",
    "get_value",
    "load_parameter_file",
]

_WAIT_S: Final = 5.0
_TYPES: Final = (
    *("not set", "boolean", "integer", "double", "string"),
    *("byte array", "boolean array", "integer array", "double array", "string array"),
)


def get_value(*, parameter_value: Any) -> Any:
    """The Python value in a rcl_interfaces/msg/ParameterValue; None if it is not set.

    For an unknown type, prints the error and returns None.
    """
    try:
        return parameter_value_to_python(parameter_value)
    except RuntimeError as error:
        print(f"Runtime error {error} raised")
        return None


def get_parameter_type_string(parameter_type: int) -> str:
    """The name of a type of rcl_interfaces/msg/ParameterType: `double array`; KeyError for an unknown one."""
    return dict(enumerate(_TYPES))[parameter_type]


def call_get_parameters(*, node: Node, node_name: str, parameter_names: list[str]) -> Any:
    """The response of GetParameters of the node `node_name`.

    Raises RuntimeError, as the functions below, if the node has no services of parameters after 5 s, or if
    the call fails.
    """
    return _call(node, node_name, lambda client: client.get_parameters(parameter_names))


def call_set_parameters(*, node: Node, node_name: str, parameters: Sequence[Any]) -> Any:
    """The response of SetParameters; `parameters` are rcl_interfaces/msg/Parameter, or Parameters."""
    return _call(node, node_name, lambda client: client.set_parameters(parameters))


def call_describe_parameters(*, node: Node, node_name: str, parameter_names: list[str] | None = None) -> Any:
    """The response of DescribeParameters."""
    return _call(node, node_name, lambda client: client.describe_parameters(parameter_names or []))


def call_list_parameters(
    *, node: Node, node_name: str, prefixes: list[str] | None = None
) -> Future[Any] | None:
    """The finished future of ListParameters; None if the node has no services of parameters after 5 s."""
    with _client(node, node_name) as client:
        if not client.wait_for_services(timeout_sec=_WAIT_S):
            return None
        future = client.list_parameters(prefixes=prefixes)
        rclpy.spin_until_future_complete(node, future)
        return future


def load_parameter_file(
    *, node: Node, node_name: str, parameter_file: str | Path, use_wildcard: bool
) -> None:
    """Set the parameters of a file, and print the result of each: failures to stderr.

    Raises RuntimeError as above, and for an invalid file, or one without parameters for this node.
    """
    found = parameter_dict_from_yaml_file(parameter_file, use_wildcard, target_nodes=[node_name])
    response = call_set_parameters(node=node, node_name=node_name, parameters=list(found.values()))
    if len(response.results) != len(found):
        raise RuntimeError(f"Not all parameters set: {len(response.results)} of {len(found)}")
    for name, result in zip(found, response.results, strict=True):
        reason = f": {result.reason}" if result.reason else ""
        if result.successful:
            print(f"Set parameter {name} successful{reason}")
        else:
            print(f"Set parameter {name} failed{reason}", file=sys.stderr)


def _call(node: Node, node_name: str, start: Callable[[AsyncParameterClient], Future[Any]]) -> Any:
    with _client(node, node_name) as client:
        if not client.wait_for_services(timeout_sec=_WAIT_S):
            raise RuntimeError(
                f"Wait for service timed out waiting for parameter services for node {node_name}"
            )
        future = start(client)
        rclpy.spin_until_future_complete(node, future)
    error = future.exception()
    response = None if error is not None else future.result()
    if response is None:
        raise RuntimeError(f"Exception while calling service of node {node_name}: {error}")
    return response


@contextmanager
def _client(node: Node, node_name: str) -> Iterator[AsyncParameterClient]:
    """A client of parameters. Its six clients of services are destroyed at the end."""
    client = AsyncParameterClient(node, node_name)
    try:
        yield client
    finally:
        for one in client._clients:
            node.destroy_client(one)

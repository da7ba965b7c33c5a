"""`rclpy.parameter_client`: reads and changes the parameters of another node.

Owns: conversion of calls to requests of the six services. Must not know: the transport of services. Each call
returns the Future of the service's response.
"""

from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from bus_ros.rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_message
from bus_ros.rclpy.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from bus_ros.rclpy.task import Future

if TYPE_CHECKING:
    from bus_ros.rclpy.callback_groups import CallbackGroup
    from bus_ros.rclpy.client import Client
    from bus_ros.rclpy.event_handler import SubscriptionEventCallbacks
    from bus_ros.rclpy.node import Node
    from bus_ros.rclpy.qos_overriding_options import QoSOverridingOptions
    from bus_ros.rclpy.subscription import Subscription

__all__ = ["AsyncParameterClient"]

_Callback = Callable[[Future[Any]], object]


class AsyncParameterClient:
    """A client for the parameters of the node `remote_node_name`; `node` sends the requests.

    A `callback` of a call gets its Future once that is done.
    """

    def __init__(
        self,
        node: "Node",
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: "CallbackGroup | None" = None,
    ) -> None:
        from bus_ros.rosidl import service_class

        self.remote_node_name = remote_node_name
        self._node = node

        def create(service: str, topic: str) -> "Client":
            return node.create_client(
                service_class(f"rcl_interfaces/srv/{service}"),
                f"{remote_node_name}/{topic}",
                qos_profile=qos_profile,
                callback_group=callback_group,
            )

        self._get_parameter_client = create("GetParameters", "get_parameters")
        self._list_parameter_client = create("ListParameters", "list_parameters")
        self._set_parameter_client = create("SetParameters", "set_parameters")
        self._get_parameter_types_client = create("GetParameterTypes", "get_parameter_types")
        self._describe_parameters_client = create("DescribeParameters", "describe_parameters")
        self._set_parameters_atomically_client = create(
            "SetParametersAtomically", "set_parameters_atomically"
        )
        self._clients = (
            self._get_parameter_client,
            self._list_parameter_client,
            self._set_parameter_client,
            self._get_parameter_types_client,
            self._describe_parameters_client,
            self._set_parameters_atomically_client,
        )

    def services_are_ready(self) -> bool:
        """Whether all six services have a server."""
        return all(client.service_is_ready() for client in self._clients)

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until all six have a server, at most `timeout_sec` seconds; returns whether they have."""
        end_s = inf if timeout_sec is None else monotonic() + timeout_sec
        for client in self._clients:
            left_s = None if end_s == inf else max(0.0, end_s - monotonic())
            if not client.wait_for_service(left_s):
                return False
        return True

    def list_parameters(
        self,
        prefixes: list[str] | None = None,
        depth: int | None = None,
        callback: _Callback | None = None,
    ) -> Future[Any]:
        """List names below any of `prefixes` (none: all), at most `depth` levels down (none: all)."""
        return _call(self._list_parameter_client, callback, prefixes=prefixes or [], depth=depth or 0)

    def get_parameters(self, names: list[str], callback: _Callback | None = None) -> Future[Any]:
        return _call(self._get_parameter_client, callback, names=names)

    def set_parameters(self, parameters: Sequence[Any], callback: _Callback | None = None) -> Future[Any]:
        """Set each parameter separately; they are Parameters, or messages of them."""
        return _call(self._set_parameter_client, callback, parameters=_messages(parameters))

    def set_parameters_atomically(
        self, parameters: Sequence[Any], callback: _Callback | None = None
    ) -> Future[Any]:
        """Set all parameters or none."""
        return _call(self._set_parameters_atomically_client, callback, parameters=_messages(parameters))

    def delete_parameters(self, names: list[str], callback: _Callback | None = None) -> Future[Any]:
        """Undeclare the parameters; a node refuses this if their type is static."""
        unset = [Parameter(name, Parameter.Type.NOT_SET) for name in names]
        return self.set_parameters(unset, callback)

    def describe_parameters(self, names: list[str], callback: _Callback | None = None) -> Future[Any]:
        return _call(self._describe_parameters_client, callback, names=names)

    def get_parameter_types(self, names: list[str], callback: _Callback | None = None) -> Future[Any]:
        return _call(self._get_parameter_types_client, callback, names=names)

    def load_parameter_file(
        self, parameter_file: str | Path, use_wildcard: bool = False, callback: _Callback | None = None
    ) -> Future[Any]:
        """Set the parameters of all sections of the file; `use_wildcard`: of the section `/**`, too.

        Raises RuntimeError if the file is invalid, and OSError if it can't be opened.
        """
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(found.values()), callback)

    def load_parameter_file_atomically(
        self, parameter_file: str | Path, use_wildcard: bool = False, callback: _Callback | None = None
    ) -> Future[Any]:
        """As `load_parameter_file`, but sets all parameters or none."""
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(found.values()), callback)

    def on_parameter_event(
        self,
        callback: Callable[[Any], object],
        qos_profile: QoSProfile = qos_profile_parameter_events,
        *,
        callback_group: "CallbackGroup | None" = None,
        event_callbacks: "SubscriptionEventCallbacks | None" = None,
        qos_overriding_options: "QoSOverridingOptions | None" = None,
        raw: bool = False,
    ) -> "Subscription[Any]":
        """Call `callback(event)` for each rcl_interfaces/msg/ParameterEvent, of any node."""
        return self._node.create_subscription(
            parameter_message("ParameterEvent"),
            "/parameter_events",
            callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )


def _messages(parameters: Sequence[Any]) -> list[Any]:
    return [one.to_parameter_msg() if isinstance(one, Parameter) else one for one in parameters]


def _call(client: "Client", callback: _Callback | None, **fields: object) -> Future[Any]:
    future = client.call_async(client.srv_type.Request(**fields))
    if callback is not None:
        future.add_done_callback(callback)
    return future

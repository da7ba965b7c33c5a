"""The service `~/get_type_description`: the description of a type that the node uses, by its hash.

Owns the parameter that switches it on, and its answers. Must not know the transport of services.
"""

from typing import Any

from bus.errors import AccessDenied, ConfigurationError
from bus.types.support import TypeSupport, type_support
from bus_ros.rclpy.exceptions import InvalidParameterTypeException
from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rclpy.qos import qos_profile_services_default
from bus_ros.rclpy.type_hash import TypeHash
from bus_ros.rclpy.validate_topic_name import TOPIC_SEPARATOR_STRING

__all__ = ["START_TYPE_DESCRIPTION_SERVICE_PARAM", "TOPIC_SEPARATOR_STRING", "TypeDescriptionService"]

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"


class TypeDescriptionService:
    """Serves the types of `node`, unless its parameter `start_type_description_service` is false.

    Raises InvalidParameterTypeException if an override of the parameter is no bool.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._service: Any = None
        if not node.has_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM):
            descriptor = parameter_message("ParameterDescriptor")(
                name=START_TYPE_DESCRIPTION_SERVICE_PARAM,
                type=Parameter.Type.BOOL.value,
                description="If enabled, start the ~/get_type_description service.",
                read_only=True,
            )
            node.declare_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, True, descriptor)
        parameter: Any = node.get_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM)
        if parameter.type_ is not Parameter.Type.BOOL:
            raise InvalidParameterTypeException(parameter, Parameter.Type.BOOL.name)
        if parameter.value:
            # If access is denied, a node works without this service.
            try:
                self._start()
            except AccessDenied as denied:
                node.get_logger().warning(f"nobody else can ask what types this node uses: {denied}")

    def destroy(self) -> None:
        """Stop serving."""
        if self._service is not None:
            self._node.destroy_service(self._service)
            self._service = None

    def _start(self) -> None:
        from bus_ros.rosidl import service_class

        self._service = self._node.create_service(
            service_class("type_description_interfaces/srv/GetTypeDescription"),
            "~/get_type_description",
            self._answer,
            qos_profile=qos_profile_services_default,
        )

    def _answer(self, request: Any, response: Any) -> Any:
        from bus_ros.rosidl.description import describe, sources_of  # late: most nodes get no request

        if TypeHash.parse(request.type_hash).version < 1:
            response.failure_reason = "Failed to parse type hash"
            return response
        for support in self._types():
            if support.hash == request.type_hash:
                try:
                    response.type_description = describe(support.name)
                    if request.include_type_sources:
                        response.type_sources = sources_of(support.name)
                except ConfigurationError as error:
                    response.failure_reason = str(error)
                else:
                    response.successful = True
                return response
        response.failure_reason = "Type not currently in use by this node"
        return response

    def _types(self) -> list[TypeSupport[Any]]:
        """The types of the node's endpoints, and of the requests and answers of its services and clients."""
        topics: list[Any] = [*self._node.publishers, *self._node.subscriptions]
        services: list[Any] = [*self._node.services, *self._node.clients]
        found = {one.msg_type for one in topics}
        for one in services:
            found |= {one.srv_type.Request, one.srv_type.Response}
        return [type_support(one) for one in found]

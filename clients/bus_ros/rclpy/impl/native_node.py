"""The native node below a node of rclpy: how to make it, and the policies of its services."""

from collections.abc import Callable, Sequence

from bus import qos as native
from bus.errors import ConfigurationError
from bus.node import SERVICE_QOS, Node
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.qos import QoSProfile, qos_profile_services_default, to_native
from bus_ros.rclpy.validate_topic_name import validate_namespace, validate_node_name

__all__ = ["make_native", "service_qos"]


class _Native(Node):
    """A native node without parameters, because the facade's node has them.

    In rclpy a node may be left to the garbage collector. `on_error` gets the exceptions of callbacks.
    """

    _takes_parameters = False
    _must_be_closed = False
    on_error: Callable[[BaseException], None] | None = None

    def _fail(self, error: BaseException) -> None:
        if self.on_error is None:
            super()._fail(error)
        else:
            self.on_error(error)


def make_native(
    name: str,
    namespace: str,
    words: Sequence[str],
    context: Context,
    enable_rosout: bool,
    *,
    on_error: Callable[[BaseException], None] | None = None,
) -> Node:
    validate_node_name(name)
    try:
        node = _Native(
            name, namespace=namespace, arguments=words, domain=context.domain_id, rosout=enable_rosout
        )
    except ConfigurationError:
        if namespace:
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
        raise
    node.on_error = on_error
    return node


def service_qos(profile: QoSProfile) -> native.QoSProfile:
    """The policies of a service. With ROS's default depth of 10, a burst of calls loses some silently."""
    return SERVICE_QOS if profile == qos_profile_services_default else to_native(profile, for_both=True)

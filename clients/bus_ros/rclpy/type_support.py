"""Checks that a class is a message or a service for the bus. Must not know their encoding."""

from bus_ros.rclpy.exceptions import NoTypeSupportImportedException

__all__ = ["check_for_type_support", "check_is_valid_msg_type", "check_is_valid_srv_type"]


def check_for_type_support(msg_or_srv_type: object) -> None:
    """Raises AttributeError if it is neither a message nor a service class.

    Raises NoTypeSupportImportedException for ROS 2's own classes, which busd can't use.
    """
    has_name = isinstance(getattr(msg_or_srv_type, "__type_name__", None), str)
    # A program's own msgspec.Struct is a message of the native API.
    if not has_name and not hasattr(msg_or_srv_type, "__struct_fields__"):
        cls = msg_or_srv_type if isinstance(msg_or_srv_type, type) else type(msg_or_srv_type)
        if hasattr(type(msg_or_srv_type), "_TYPE_SUPPORT"):  # made by rosidl, or by a program's test
            raise NoTypeSupportImportedException
        raise AttributeError(
            f"type object '{cls.__name__}' has no attribute '_TYPE_SUPPORT'"
            " This might be a ROS 1 message type but it should be a ROS 2 message type."
            " Make sure to source your ROS 2 workspace after your ROS 1 workspace."
        )


def check_is_valid_msg_type(msg_type: object) -> None:
    """Raises AttributeError as above, RuntimeError for a service or an action."""
    check_for_type_support(msg_type)
    if hasattr(msg_type, "Request") or hasattr(msg_type, "Goal"):
        raise RuntimeError(
            f"The message type provided is not valid ({msg_type}), this might be a service or action"
        )


def check_is_valid_srv_type(srv_type: object) -> None:
    """Raises AttributeError as above, RuntimeError for a message or an action."""
    check_for_type_support(srv_type)
    if getattr(srv_type, "__described__", None) is not None:
        return  # a service: this needs no message classes
    if not (hasattr(srv_type, "Request") and hasattr(srv_type, "Response")):
        raise RuntimeError(
            f"The service type provided is not valid ({srv_type}), this might be a message or action"
        )

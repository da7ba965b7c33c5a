"""Names of types in DDS, which ROS 2 also uses in the keys of Zenoh. Pure."""

import re
from typing import Final

__all__ = ["type_from_dds", "type_to_dds"]

_TYPE: Final = re.compile(r"(\w+)::(msg|srv|action)::dds_::(\w+)_", re.ASCII)


def type_to_dds(type_name: str) -> str:
    """Convert `std_msgs/msg/String` to `std_msgs::msg::dds_::String_`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def type_from_dds(dds_type: str) -> str | None:
    """Convert `std_msgs::msg::dds_::String_` to `std_msgs/msg/String`; None if it is not a type of ROS 2."""
    found = _TYPE.fullmatch(dds_type)
    return "/".join(found.groups()) if found else None

"""Definitions by name."""

import pytest

from bus_ros.ros2interface import api
from rows import for_each


def test_all_types() -> None:
    types = api.type_completer()
    assert types == sorted(types)
    assert {"std_msgs/msg/String", "std_srvs/srv/SetBool", "example_interfaces/action/Fibonacci"} < set(types)
    assert "std_msgs" in api.package_name_completer()


@for_each(
    ("name", "text"),
    [
        ("geometry_msgs/msg/Point", "x: 0.0\ny: 0.0\nz: 0.0\n"),
        ("std_srvs/srv/SetBool", "data: false\n"),
        ("example_interfaces/action/Fibonacci", "order: 0\n"),
    ],
)
def test_default_values(name: str, text: str) -> None:
    assert api.interface_to_yaml(name) == text


def test_unknown_types() -> None:
    with pytest.raises(ModuleNotFoundError, match="No module named 'no_msgs'"):
        api.interface_to_yaml("no_msgs/msg/A")

"""Inside of rclpy, with names that programs import all the same: the logger's class, severities, errors."""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name == "implementation_singleton":  # programs use it after nothing but `import rclpy`
        return import_module("bus_ros.rclpy.impl.implementation_singleton")
    raise AttributeError(f"module 'rclpy.impl' has no attribute {name!r}")

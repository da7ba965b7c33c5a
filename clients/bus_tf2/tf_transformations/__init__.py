"""`tf_transformations` on the bus: angles, quaternions and matrices. NumPy is imported where it is needed."""

from importlib import import_module
from typing import Any

from bus_ros.extras import extra
from bus_tf2.tf_transformations.angles import (
    euler_from_quaternion,
    quaternion_about_axis,
    quaternion_from_euler,
    quaternion_multiply,
)

__all__ = ["euler_from_quaternion", "quaternion_about_axis", "quaternion_from_euler", "quaternion_multiply"]


def __getattr__(name: str) -> Any:
    if not name.startswith("_") and name not in ("angles", "matrices"):
        extra("numpy", "tf_transformations")
        matrices = import_module("bus_tf2.tf_transformations.matrices")
        if name in matrices.__all__:
            return getattr(matrices, name)
    raise AttributeError(f"module 'tf_transformations' has no attribute {name!r}")

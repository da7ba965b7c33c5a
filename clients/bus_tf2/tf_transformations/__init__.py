"""`tf_transformations` on the bus: angles, quaternions and matrices. NumPy is imported on demand.

`angles.py` is plain Python, for the functions that most programs use. `matrices.py`, `projections.py` and
`arcball.py` need NumPy and are imported when one of their names is first asked for.

Invariants: names and results are those of ROS 2's package; quaternions are (x, y, z, w).

Read first: `angles.py`. Tests: `tests/unit/bus_tf2/tf_transformations/`.
"""

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

_WITH_NUMPY = ("matrices", "projections", "arcball")


def __getattr__(name: str) -> Any:
    if not name.startswith("_") and name not in ("angles", *_WITH_NUMPY):
        extra("numpy", "tf_transformations")
        for part in _WITH_NUMPY:
            module = import_module(f"bus_tf2.tf_transformations.{part}")
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module 'tf_transformations' has no attribute {name!r}")

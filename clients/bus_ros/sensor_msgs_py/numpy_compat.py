"""Conversion between structured and plain arrays: NumPy's own functions of these names."""

from typing import TYPE_CHECKING, Any

from bus_ros.extras import extra

if TYPE_CHECKING:
    import numpy as np

__all__ = ["structured_to_unstructured", "unstructured_to_structured"]


def structured_to_unstructured(
    arr: "np.ndarray[Any, Any]", dtype: Any = None, copy: bool = False, casting: Any = "unsafe"
) -> "np.ndarray[Any, Any]":
    """A plain array with one more dimension; its columns are the fields."""
    plain: np.ndarray[Any, Any]
    plain = _functions().structured_to_unstructured(arr, dtype=dtype, copy=copy, casting=casting)
    return plain


def unstructured_to_structured(
    arr: "np.ndarray[Any, Any]",
    dtype: Any = None,
    names: Any = None,
    align: bool = False,
    copy: bool = False,
    casting: Any = "unsafe",
) -> "np.ndarray[Any, Any]":
    """A structured array with one dimension less; its fields are the columns."""
    named: np.ndarray[Any, Any] = _functions().unstructured_to_structured(
        arr, dtype=dtype, names=names, align=align, copy=copy, casting=casting
    )
    return named


def _functions() -> Any:
    extra("numpy", "sensor_msgs_py")
    from numpy.lib import recfunctions

    return recfunctions

"""Arrays of numbers as in rosidl: sequences are array.array, arrays of a fixed size are numpy's.

Owns: type codes, conversion, and numpy. numpy is imported when the first array of a fixed size is made; if it
is not installed, array.array replaces it. Must not know: fields, messages.
"""

import sys
from array import array
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from importlib import import_module
from typing import Final, Protocol, TypeGuard, cast

__all__ = ["CODES", "NumpyArray", "fixed", "is_array", "numpy", "octets", "plain", "same", "sequence"]

CODES: Final = {
    "int8": "b",
    "uint8": "B",
    "char": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""Type code of array.array for each numeric type of definitions."""


class Dtype(Protocol):
    """The used part of numpy.dtype."""

    char: str
    isnative: bool

    def __eq__(self, other: object, /) -> bool: ...


class NumpyArray(Protocol):
    """The used part of numpy.ndarray."""

    dtype: Dtype
    ndim: int
    size: int

    def __iter__(self) -> Iterator[float]: ...
    def ravel(self) -> "NumpyArray": ...
    def tobytes(self) -> bytes: ...
    def tolist(self) -> list[float]: ...


class Numpy(Protocol):
    """The used part of the module numpy."""

    def dtype(self, code: str) -> Dtype: ...
    def array(self, values: object, dtype: Dtype) -> NumpyArray: ...
    def frombuffer(self, data: bytearray, dtype: Dtype) -> NumpyArray: ...


@cache
def numpy() -> Numpy | None:
    """The module, or None if it isn't installed."""
    try:
        return cast(Numpy, import_module("numpy"))
    except ImportError:
        return None


def is_array(value: object) -> TypeGuard[NumpyArray]:
    """Whether `value` is an array of numpy; doesn't import it."""
    ndarray: type | tuple[()] = getattr(sys.modules.get("numpy"), "ndarray", ())
    return isinstance(value, ndarray)


class _Scalar(Protocol):
    def item(self) -> object: ...


def plain(value: object) -> object:
    """The Python value of a numpy scalar; any other value as it is."""
    generic: type[_Scalar] | tuple[()] = getattr(sys.modules.get("numpy"), "generic", ())
    # A double of numpy is a float already.
    return value.item() if isinstance(value, generic) and not isinstance(value, float) else value


def sequence(code: str, value: Iterable[float]) -> "array[float]":
    """An array.array with the values of `value`. Raises TypeError or OverflowError for invalid values."""
    if is_array(value):
        value = value.ravel()
        if value.dtype.isnative and (value.dtype.char == code or value.dtype == code):
            return _from_bytes(code, value.tobytes())
        return array(code, value.tolist())
    if code == "B" and isinstance(value, memoryview):
        return _from_bytes(code, value)
    return array(code, value)


def _from_bytes(code: str, data: bytes | memoryview) -> "array[float]":
    made: array[float] = array(code)
    made.frombytes(data)
    return made


@cache
def fixed(code: str) -> Callable[[Iterable[float]], Iterable[float]]:
    """A function that makes an array of a fixed size from bytes, or from any values that `sequence` takes."""
    module = numpy()
    if module is None:
        return lambda values: sequence(code, values)
    dtype, make = module.dtype(code), module.array
    if code == "B":
        octets = cast("Callable[[Iterable[float]], bytearray]", bytearray)
        return lambda values: make(values if is_array(values) else octets(values), dtype)
    return lambda values: make(values, dtype)


@cache
def octets() -> Callable[[bytearray], Iterable[float]]:
    """A native function that makes an array of a fixed size from bytes, and keeps them."""
    module = numpy()
    return partial(array, "B") if module is None else partial(module.frombuffer, dtype=module.dtype("B"))


def same(first: object, second: object) -> bool:
    """Whether two values of a field are equal; arrays of numpy have no truth value."""
    if is_array(first) or is_array(second):
        return bool(_listed(first) == _listed(second))
    return bool(first == second)


def _listed(value: object) -> object:
    return value.tolist() if hasattr(value, "tolist") else value

"""Runs of primitives in CDR: the struct for each offset at which one can begin.

Owns: alignment. Must not know: shapes, payloads.
"""

from struct import Struct
from typing import Final, NamedTuple

__all__ = ["CODES", "Run", "lay_out"]

CODES: Final = {
    "bool": "?",
    "byte": "c",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""The code of the module struct for each primitive; but for `bool` and `byte` also that of array.array."""

_SIZES: Final = {
    "x": 1,
    "?": 1,
    "c": 1,
    "B": 1,
    "b": 1,
    "h": 2,
    "H": 2,
    "i": 4,
    "I": 4,
    "q": 8,
    "Q": 8,
    "f": 4,
    "d": 8,
}


class Run(NamedTuple):
    """Primitives one after another, from a known offset on."""

    struct: Struct
    size: int
    """With the padding that comes first."""


def lay_out(codes: list[tuple[str, int]], offset: int, order: str = "<", alignment: int = 8) -> Run:
    """`codes`: each with how often it stands there; an array of a fixed size is one. `x` is a byte that is 0.

    `offset` counts modulo 8; `alignment` is the greatest that there is.
    """
    position, form = offset, order
    for code, count in codes:
        size = _SIZES[code]
        padding = -position % min(size, alignment)
        form += f"{padding}x{count}{code}" if padding else f"{count}{code}"
        position += padding + size * count
    return Run(Struct(form), position - offset)

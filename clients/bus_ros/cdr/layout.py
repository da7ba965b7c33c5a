"""Runs of primitives in CDR: a struct for each offset at the start of a run, and for each length of a list.

Owns: alignment. Must not know: shapes, payloads.
"""

from collections.abc import Callable
from struct import Struct, calcsize
from typing import Any, Final, NamedTuple

__all__ = ["CODES", "Arrays", "Run", "Runs", "lay_out"]

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
"""The code of the module struct for each primitive."""

_MOST_KEPT: Final = 256

_SIZES: Final = {code: calcsize(f"={code}") for code in ("x", *CODES.values())}


class Run(NamedTuple):
    """Primitives one after another, from a known offset on."""

    struct: Struct
    size: int
    """Including the padding at its start."""


def lay_out(codes: list[tuple[str, int]], offset: int, order: str = "<", alignment: int = 8) -> Run:
    """The run of `codes` that begins at `offset`, modulo 8; `alignment` is the greatest alignment.

    Each code comes with its number of repetitions; an array of fixed size is one entry. `x` is a zero byte.
    """
    position, form = offset, order
    for code, count in codes:
        size = _SIZES[code]
        padding = -position % min(size, alignment)
        form += f"{padding}x{count}{code}" if padding else f"{count}{code}"
        position += padding + size * count
    return Run(Struct(form), position - offset)


class Runs(dict[int, tuple[Callable[..., bytes], int]]):
    """Runs that end with a list of numbers: from `length << 3 | offset` to the pack function and the end."""

    def __init__(self, codes: list[tuple[str, int]], code: str) -> None:
        self._codes, self._code = codes, code

    def __missing__(self, key: int) -> tuple[Callable[..., bytes], int]:
        count, offset = key >> 3, key & 7
        run = lay_out([*self._codes, (self._code, count)] if count else self._codes, offset)
        if len(self) >= _MOST_KEPT:
            self.clear()
        made = self[key] = run.struct.pack, (offset + run.size) % 8
        return made


class Arrays(dict[int, Callable[[Any, int], tuple[Any, ...]]]):
    """Unpack functions for the numbers of a list, by its length."""

    def __init__(self, order: str, code: str) -> None:
        self._order, self._code = order, code

    def __missing__(self, count: int) -> Callable[[Any, int], tuple[Any, ...]]:
        if len(self) >= _MOST_KEPT:
            self.clear()
        made = self[count] = Struct(f"{self._order}{count}{self._code}").unpack_from
        return made

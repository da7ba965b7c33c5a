"""Lines of Python that are made for one type, and the objects that they use.

Owns: what is written where it stands, and what gets a function of its own. No name of a type or a field gets
into the source: they come from other processes.
"""

from typing import Any, Final

from bus_ros.cdr.shapes import Bytes, Json, Message, Primitive, Shape

__all__ = ["Source"]

_MOST_INLINE: Final = 32
_MOST_LINES: Final = 4000
_MOST_LOOPS: Final = 6
"""Beyond these a message in a message gets a function of its own: Python has its limits, too."""


class Source:
    """Functions in the making. Each is written to the end before another one goes on."""

    def __init__(self, **names: Any) -> None:
        self.names: dict[str, Any] = names
        self.functions: dict[Shape, str] = {}
        """Those that have been written for a shape, by their names."""
        self.loops = 0
        """How many are around what is written next."""
        self._length = 0
        self._done: list[str] = []
        self._open: list[list[str]] = []
        self._indents: list[int] = []
        self._outer_loops: list[int] = []
        self._count = 0

    def line(self, text: str) -> None:
        self._open[-1].append(" " * self._indents[-1] + text)
        self._length += 1

    def first(self, text: str) -> None:
        """A line at the beginning of the function that is being written."""
        self._open[-1].insert(1, f" {text}")

    def indent(self, by: int = 1) -> None:
        self._indents[-1] += by

    def begin(self, head: str) -> None:
        """A function; the one that was being written goes on when this one has come to its end."""
        self._open.append([f"{head}:"])
        self._indents.append(1)
        self._outer_loops.append(self.loops)
        self.loops = 0

    def end(self) -> None:
        self._done += self._open.pop()
        self._indents.pop()
        self.loops = self._outer_loops.pop()

    def has_room(self, shape: Shape) -> bool:
        """Whether a value of this shape is written where it stands, and not by a function of its own."""
        if isinstance(shape, Message) and (shape.leaves > _MOST_INLINE or self._length > _MOST_LINES):
            return False
        return self.loops < _MOST_LOOPS or isinstance(shape, Primitive | Bytes | Json)

    def variable(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def constant(self, value: Any) -> str:
        """The name under which the functions know an object."""
        self._count += 1
        self.names[f"c{self._count}"] = value
        return f"c{self._count}"

    def compile(self, about: str) -> dict[str, Any]:
        """The functions by their names."""
        exec(compile("\n".join(self._done), f"<cdr: {about}>", "exec"), self.names)
        return self.names

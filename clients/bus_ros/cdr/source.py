"""Generated Python source for one type, and the objects that it uses.

Owns: the choice between inline code and a separate function. No name of a type or a field gets into the
source, because these names come from other processes.
"""

from typing import Any, Final

from bus_ros.cdr.shapes import Bytes, Json, Message, Primitive, Shape

__all__ = ["Source"]

_MOST_INLINE: Final = 32
_MOST_LINES: Final = 4000
_MOST_LOOPS: Final = 6
"""With more nested loops, a nested message gets its own function, because Python limits nesting."""


class Source:
    """Functions being generated. Each is finished before the outer one continues."""

    def __init__(self, **names: Any) -> None:
        self.names: dict[str, Any] = names
        self.functions: dict[Shape, str] = {}
        """The names of the functions written so far, by shape."""
        self.loops = 0
        """The number of loops around the next line."""
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
        """Insert a line at the beginning of the current function."""
        self._open[-1].insert(1, f" {text}")

    def indent(self, by: int = 1) -> None:
        self._indents[-1] += by

    def begin(self, head: str) -> None:
        """Begin a function; the outer one continues at `end`."""
        self._open.append([f"{head}:"])
        self._indents.append(1)
        self._outer_loops.append(self.loops)
        self.loops = 0

    def end(self) -> None:
        self._done += self._open.pop()
        self._indents.pop()
        self.loops = self._outer_loops.pop()

    def has_room(self, shape: Shape) -> bool:
        """Whether the code for a value of this shape is written inline, not as a separate function."""
        if isinstance(shape, Message) and (shape.leaves > _MOST_INLINE or self._length > _MOST_LINES):
            return False
        return self.loops < _MOST_LOOPS or isinstance(shape, Primitive | Bytes | Json)

    def variable(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def constant(self, value: Any) -> str:
        """The name of an object in the functions."""
        self._count += 1
        self.names[f"c{self._count}"] = value
        return f"c{self._count}"

    def compile(self, about: str) -> dict[str, Any]:
        """Compile the functions; returns them by name."""
        exec(compile("\n".join(self._done), f"<cdr: {about}>", "exec"), self.names)
        return self.names

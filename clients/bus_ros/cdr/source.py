"""Lines of Python that are made for one type, and the objects that they use.

No name of a type or a field gets into the source: they come from other processes.
"""

from typing import Any

__all__ = ["Source"]


class Source:
    """Functions in the making. Each is written to the end before another one goes on."""

    def __init__(self, **names: Any) -> None:
        self.names: dict[str, Any] = names
        self.length = 0
        self._done: list[str] = []
        self._open: list[list[str]] = []
        self._indents: list[int] = []
        self._count = 0

    def line(self, text: str) -> None:
        self._open[-1].append(" " * self._indents[-1] + text)
        self.length += 1

    def first(self, text: str) -> None:
        """A line at the beginning of the function that is being written."""
        self._open[-1].insert(1, f" {text}")

    def indent(self, by: int = 1) -> None:
        self._indents[-1] += by

    def begin(self, head: str) -> None:
        """A function; the one that was being written goes on when this one has come to its end."""
        self._open.append([f"{head}:"])
        self._indents.append(1)

    def end(self) -> None:
        self._done += self._open.pop()
        self._indents.pop()

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

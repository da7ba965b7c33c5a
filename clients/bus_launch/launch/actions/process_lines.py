"""The output of a process as lines, for the screen and the log. Pure, except for the loggers."""

import codecs
from collections.abc import Callable
from logging import Logger
from typing import Final

__all__ = ["ProcessLines"]

_LONGEST: Final = 1 << 20
"""Characters; a longer line is cut there."""


class ProcessLines:
    """Cuts output into lines. A line without an end waits for it, or for `flush`."""

    def __init__(self, loggers: tuple[Logger, Logger], form: Callable[[str], str], *, keep: bool) -> None:
        """`loggers`: for stdout and stderr. `keep`: `text` returns the whole output."""
        self._loggers = dict(zip(("stdout", "stderr"), loggers, strict=True))
        self._form = form
        self._kept: dict[str, list[str]] | None = {source: [] for source in self._loggers} if keep else None
        self._open = dict.fromkeys(self._loggers, "")
        make = codecs.getincrementaldecoder("utf-8")
        self._decoders = {source: make(errors="replace") for source in self._loggers}

    def feed(self, source: str, data: bytes) -> None:
        self._add(source, self._decoders[source].decode(data))

    def flush(self) -> None:
        """The process has ended: an unfinished line counts as a line."""
        for source, decoder in self._decoders.items():
            self._add(source, decoder.decode(b"", final=True))
            decoder.reset()
            rest, self._open[source] = self._open[source], ""
            if rest:
                self._say(source, rest)

    def text(self, source: str) -> str:
        return "" if self._kept is None else "".join(self._kept[source])

    def _add(self, source: str, text: str) -> None:
        if self._kept is not None:
            self._kept[source].append(text)
        *lines, rest = (self._open[source] + text).split("\n")
        for line in lines:
            self._say(source, line)
        while len(rest) > _LONGEST:
            self._say(source, rest[:_LONGEST])
            rest = rest[_LONGEST:]
        self._open[source] = rest

    def _say(self, source: str, line: str) -> None:
        self._loggers[source].info(self._form(line))

"""A line at the bottom of a terminal that is rewritten again and again, with the log above it."""

import logging
import sys
from typing import Final

from bus.logger import TOP_NAME
from bus_bag.terminal.foreground import is_in_foreground

__all__ = ["StatusLine"]

_ERASE: Final = "\r\x1b[K"


class StatusLine(logging.Filter):
    """Writes to the standard output if that is a terminal; otherwise writes nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.is_shown = bool(sys.stdout is not None and sys.stdout.isatty())
        """Whether there is a terminal to show it on."""
        self._is_written = False
        if self.is_shown:
            # Each log line erases it first; the next `show` writes it again.
            for handler in logging.getLogger(TOP_NAME).handlers:
                handler.addFilter(self)

    def show(self, text: str) -> None:
        """Replace the text of the line."""
        if self.is_shown and is_in_foreground(sys.stdout.fileno()):
            self._write(f"{_ERASE}{text}")
            self._is_written = True

    def erase(self) -> None:
        """Erase the line."""
        if self._is_written:
            self._write(_ERASE)
            self._is_written = False

    def close(self) -> None:
        """Leave the last text on the screen; later output goes below it."""
        if self._is_written:
            self._write("\n")
            self._is_written = False
        for handler in logging.getLogger(TOP_NAME).handlers:
            handler.removeFilter(self)

    def filter(self, record: logging.LogRecord) -> bool:
        self.erase()
        return True

    def _write(self, text: str) -> None:
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except (OSError, ValueError):  # the terminal has gone
            self.is_shown = False

"""Errors of launch files."""

from collections.abc import Sequence
from typing import Final

__all__ = ["InvalidLaunchFileError", "describe", "short"]

_LONGEST: Final = 60


class InvalidLaunchFileError(Exception):
    """A launch file that can't be read, with the errors of reading it."""

    def __init__(self, extension: str = "", *, likely_errors: Sequence[Exception] = ()) -> None:
        super().__init__()
        self._extension = extension
        self._likely_errors = list(likely_errors)
        if self._likely_errors:
            self.__cause__ = self._likely_errors[0]

    def __str__(self) -> str:
        if not self._likely_errors:
            return "The launch file may have a syntax error, or its format is unknown"
        kind = f" of format [{self._extension}]" if self._extension else ""
        if len(self._likely_errors) == 1:
            return f"Caught exception when trying to load file{kind}: {describe(self._likely_errors[0])}"
        listed = "".join(f"\n - {describe(one)}" for one in self._likely_errors)
        return f"Caught multiple exceptions when trying to load file{kind}:{listed}"


def describe(error: BaseException) -> str:
    """Its text; if it has none, its class."""
    if isinstance(error, SyntaxError) or not isinstance(error, KeyError):
        return str(error) or type(error).__name__
    text = str(error)
    return text if type(error) is not KeyError else f"KeyError: {text}"


def short(value: object) -> str:
    """How Python writes it, its first 60 characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."

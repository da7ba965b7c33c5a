"""Checks of names that users choose: the id of a bus, and the group of a bus. Pure.

Both are parts of keys of zenoh.
"""

import re
from typing import Final

from bus.errors import ConfigurationError

__all__ = ["checked_group", "checked_id"]

_MAX_LENGTH: Final = 64
_RIGHT: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def checked_id(text: str) -> str:
    """Check the id of a bus and return it. Raises ConfigurationError if it is not valid."""
    return _checked("the id of a bus", text)


def checked_group(text: str) -> str:
    """Check the name of a group and return it. Raises ConfigurationError if it is not valid."""
    return _checked("the name of a group", text)


def _checked(subject: str, text: str) -> str:
    if len(text) > _MAX_LENGTH or not _RIGHT.fullmatch(text):
        raise ConfigurationError(
            f"{subject} has letters, digits, '-', '_' and '.', begins with a letter or digit, and has "
            f"at most {_MAX_LENGTH} characters; it is {text[: _MAX_LENGTH + 1]!r}"
        )
    return text

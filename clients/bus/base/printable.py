"""Texts of other processes, made safe for a terminal and a log.

A terminal executes all escape sequences in a text. Other characters reverse the order of a line, or begin a
line that looks like another process's. Owns the list of these characters, and their replacements.
"""

import re
from functools import cache

__all__ = ["printable", "printable_json"]

_HOSTILE = (
    "[\x00-\x1f\x7f-\x9f"  # control characters: C0, DEL, C1
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # Unicode's Bidi_Control: they reverse the order
    "\u2028\u2029"  # separators of lines and paragraphs
    "\ud800-\udfff]"  # half a character, which can't be written at all
)


def printable(text: str, keep: str = "\n\t") -> str:
    r"""`text` with an escape for each control character that is not in `keep`: `\r`, `\x1b`, `\u202e`.

    Without `keep` it is one line. Backslashes stay as they are, so `text` can't be recovered from the result.
    """
    if text.isprintable():
        return text
    return _hostile(keep).sub(_escape, text)


def printable_json(text: str) -> str:
    """The same for JSON, from which `text` can be recovered: characters that JSON allows are escaped as in
    JSON."""
    return text if text.isprintable() else _hostile("").sub(lambda found: f"\\u{ord(found[0]):04x}", text)


@cache
def _hostile(keep: str) -> re.Pattern[str]:
    """The pattern of escaped characters, compiled for the first text: most programs need none."""
    return re.compile(f"(?![{re.escape(keep)}]){_HOSTILE}" if keep else _HOSTILE)


def _escape(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode()

"""Texts of other processes, made safe for a terminal and a log.

A terminal obeys all escape sequences that come to it; other characters reverse the order of a line, or begin
one that looks like another process's. Owns which characters these are, and what replaces them.
"""

import re
from functools import cache

__all__ = ["printable", "printable_json"]

_HOSTILE = (
    "[\x00-\x1f\x7f-\x9f"  # control characters: C0, DEL, C1
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # Unicode's Bidi_Control: they turn the order around
    "\u2028\u2029"  # separators of lines and paragraphs
    "\ud800-\udfff]"  # half a character: it can't be written at all
)


def printable(text: str, keep: str = "\n\t") -> str:
    r"""`text` with an escape for each control character that is not in `keep`: `\r`, `\x1b`, `\u202e`.

    Without `keep` it is one line. Backslashes stay as they are, so `text` can't be told from the result.
    """
    if text.isprintable():
        return text
    return _hostile(keep).sub(_escape, text)


def printable_json(text: str) -> str:
    """The same for JSON, where `text` can be told: what JSON itself lets stand is escaped in its way."""
    return text if text.isprintable() else _hostile("").sub(lambda found: f"\\u{ord(found[0]):04x}", text)


@cache
def _hostile(keep: str) -> re.Pattern[str]:
    """Compiled when the first text needs it: most programs see none."""
    return re.compile(f"(?![{re.escape(keep)}]){_HOSTILE}" if keep else _HOSTILE)


def _escape(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode()

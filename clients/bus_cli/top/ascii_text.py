"""Texts for terminals that can show ASCII only: `LC_ALL=C`, `TERM=dumb`. Pure."""

from collections.abc import Mapping

__all__ = ["ascii_text", "is_ascii_only", "is_dumb"]

_INSTEAD = str.maketrans(
    {
        **dict(zip("µ…→•\N{EN DASH}\N{MINUS SIGN}\N{NO-BREAK SPACE}", "u~>*-- ", strict=True)),
        **dict(zip("▁▂▃▄▅▆▇█", "_.-:=+*#", strict=True)),  # bars
        **dict.fromkeys("▏▎▍▌▋▊▉▔▕", " "),  # a scrollbar's edges
        **dict.fromkeys("╭╮╰╯┌┐└┘├┤┬┴┼", "+"),
        **dict.fromkeys("─━", "-"),
        **dict.fromkeys("│┃", "|"),
    }
)
"""One character for each: columns stay aligned."""


def is_dumb(environ: Mapping[str, str]) -> bool:
    """Whether the terminal can't place text: it understands no escape sequences."""
    return environ.get("TERM") == "dumb"


def is_ascii_only(environ: Mapping[str, str]) -> bool:
    """Whether the terminal is dumb or the user's locale has another encoding than UTF-8.

    Without any locale, the terminal counts as one of UTF-8, like in Python.
    """
    names = (environ.get(name) for name in ("LC_ALL", "LC_CTYPE", "LANG"))
    locale = next(filter(None, names), "utf-8")
    return is_dumb(environ) or "utf8" not in locale.lower().replace("-", "")


def ascii_text(text: str) -> str:
    """`text` with a similar ASCII character, or `?`, for each other one."""
    return text if text.isascii() else text.translate(_INSTEAD).encode("ascii", "replace").decode()

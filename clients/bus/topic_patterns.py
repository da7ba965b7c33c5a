"""Patterns for topic names in the rules of busd.toml and of bridges.

Owns the meaning of patterns, and the check for patterns that can never match. Must not know the effect of a
rule.

`*` stands for any characters except "/", `**` for any characters, `?` for one character except "/", `[abc]`,
`[a-z]` and `[!abc]` for one character in or outside a set. The whole name must match.
"""

import re
from functools import lru_cache

from bus.errors import ConfigurationError

__all__ = ["compiled", "shown"]

_TOKEN = re.compile(
    r"""(?P<any>\*\*+) | (?P<part>\*) | (?P<one>\?)
      | \[ (?P<not>!?) (?P<set>(?:[A-Za-z0-9_](?:-[A-Za-z0-9_])?)+) \]
      | (?P<plain>[A-Za-z0-9_/]+)""",
    re.VERBOSE,
)


@lru_cache(maxsize=1024)
def compiled(pattern: str, key: str) -> re.Pattern[str]:
    """The regular expression for a pattern; its `fullmatch` accepts the matching full names.

    Raises ConfigurationError, naming the `key` with the pattern, if no name can match.
    """
    if not pattern.startswith(("/", "**")):
        raise _hopeless(key, pattern, "a topic's full name begins with '/' (or begin with '**')")
    if pattern.endswith("/") or "//" in pattern:
        raise _hopeless(key, pattern, "a topic's name has no empty part")
    regex, at = "", 0
    while at < len(pattern):
        token = _TOKEN.match(pattern, at)
        if token is None:
            raise _hopeless(
                key, pattern, f"{pattern[at]!r} at position {at} is neither part of a name nor of a pattern"
            )
        at = token.end()
        regex += _translate(token)
    try:
        return re.compile(regex)
    except re.error as error:
        raise _hopeless(key, pattern, error.msg) from None


def shown(value: object) -> str:
    """`value` for an error's text, shortened if it is too long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _translate(token: re.Match[str]) -> str:
    match token.lastgroup:
        case "any":
            return ".*"
        case "part":
            return "[^/]*"
        case "one":
            return "[^/]"
        case "set":
            return f"[^/{token['set']}]" if token["not"] else f"[{token['set']}]"
        case _:
            return token[0]


def _hopeless(key: str, pattern: str, why: str) -> ConfigurationError:
    return ConfigurationError(f"{key} = {shown(pattern)} can never match: {why}")

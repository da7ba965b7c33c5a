"""Loads untrusted YAML: in C, except for deeply nested texts, which would overflow the stack there."""

import re
from typing import Any

__all__ = ["load"]

_DEEP = re.compile(r"^[\s\-?:]{200}", re.MULTILINE)
_TOO_DEEP = re.compile(r"[\[{]{200}")
_MOST_OPENED = 2000
_SIXTIETHS = re.compile(r"(?::[0-5]?[0-9])+")
_MOST_SIXTIETHS = 100
"""Longest text of a number to the base 60, `1:30:00`. YAML's library takes hours for some megabytes."""


def load(text: str, *, has_aliases: bool = True) -> object:
    """Load a document. Raises ValueError with the reason if `text` is not valid YAML.

    Without `has_aliases`, it also refuses aliases (`*name`).
    """
    import yaml

    if _TOO_DEEP.search(text):
        raise ValueError("it is nested too deeply")
    if any(len(found[0]) > _MOST_SIXTIETHS for found in _SIXTIETHS.finditer(text)):
        raise ValueError("it has too long a number to the base 60")
    is_deep = text.count("[") + text.count("{") > _MOST_OPENED or _DEEP.search(text) is not None
    in_c = None if is_deep else getattr(yaml, "CSafeLoader", None)
    loader = in_c or yaml.SafeLoader
    if not has_aliases and "*" in text and _has_alias(text, loader):
        raise ValueError("it has an alias, which a short text can use to fill the memory")
    try:
        return yaml.load(text, Loader=loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise ValueError(f"it is not YAML{line}: {reason}") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError as error:  # of a value: a date that is none
        raise ValueError(f"it is not YAML: {error}") from None


def _has_alias(text: str, loader: Any) -> bool:
    import yaml

    try:
        return any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=loader))
    except yaml.YAMLError:  # the loader will say it
        return False

"""Loads untrusted YAML: in C, except for deeply nested texts, which would overflow the stack there."""

import re

__all__ = ["load"]

_DEEP = re.compile(r"^[\s\-?:]{200}", re.MULTILINE)
_TOO_DEEP = re.compile(r"[\[{]{200}")
_MOST_OPENED = 2000


def load(text: str) -> object:
    """Load a document. Raises ValueError with the reason if `text` is not valid YAML."""
    import yaml

    if _TOO_DEEP.search(text):
        raise ValueError("it is nested too deeply")
    is_deep = text.count("[") + text.count("{") > _MOST_OPENED or _DEEP.search(text) is not None
    in_c = None if is_deep else getattr(yaml, "CSafeLoader", None)
    try:
        return yaml.load(text, Loader=in_c or yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise ValueError(f"it is not YAML{line}: {reason}") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError as error:  # of a value: a date that is none
        raise ValueError(f"it is not YAML: {error}") from None

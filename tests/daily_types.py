"""The part of all types that `make test` tries: each kind of field, and one type in eight.

`make nightly` tries all types.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from zlib import crc32

import bus
from bus.types.idl import PRIMITIVES
from effort import is_nightly

__all__ = ["SHARE", "daily_part"]

SHARE = Path(str(bus.__file__)).parent / "share"
_ONE_IN = 8
_FIELD = re.compile(r"^\s*([\w/]+)(<=\d+)?(\[[^\]]*\])?\s+\w+", re.MULTILINE)


def daily_part(names: Iterable[str]) -> list[str]:
    """All of these types in `make nightly`. Call it only once the tests are collected."""
    if is_nightly():
        return [*names]
    seen: set[str] = set()
    found = []
    for name in names:
        kinds = _kinds(name)
        if not kinds <= seen or not crc32(name.encode()) % _ONE_IN:
            seen |= kinds
            found.append(name)
    return found


def _kinds(name: str) -> set[str]:
    """The kinds of a type's fields: `float64[N]`, `string<=N`, `message[]`. Each type has `any`."""
    path = SHARE / f"{name}.{name.split('/')[1]}"
    if not path.exists():
        return set()  # a part of a service or an action
    return {"any"} | {
        (base if base in {*PRIMITIVES, "byte", "char"} else "message") + re.sub(r"\d+", "N", most + many)
        for base, most, many in _FIELD.findall(path.read_text())
    }

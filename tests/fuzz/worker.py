"""One target under atheris, as a process: `python -m fuzz.worker frames [options of libFuzzer]`.

Only our packages are instrumented: what is covered is what belongs to us. And the targets themselves, as
nothing is seen here of the native core that some use; and the functions that codecs make, where the codecs
stay the same.
"""

import sys
from types import FunctionType
from typing import Any

import atheris  # type: ignore[import-untyped, import-not-found, unused-ignore]

from fuzz import OURS

with atheris.instrument_imports(include=[*OURS, "fuzz"]):
    from bus_ros.cdr.source import Source
    from fuzz.targets import TARGETS

_compile = Source.compile


def _instrumented(source: Source, about: str) -> dict[str, Any]:
    made = _compile(source, about)
    for key, value in made.items():
        if isinstance(value, FunctionType) and value.__globals__ is made:
            made[key] = atheris.instrument_func(value)
    return made


name = sys.argv.pop(1)
if name in ("cdr", "wheels"):
    patched: Any = Source
    patched.compile = _instrumented
atheris.Setup(sys.argv, TARGETS[name])
atheris.Fuzz()

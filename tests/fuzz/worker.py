"""One target under atheris, as a process: `python -m fuzz.worker frames [options of libFuzzer]`.

Only our packages are instrumented, so coverage is only counted there. The targets themselves are
instrumented, too: atheris sees nothing of the native core that some of them use. So are functions generated
by codecs, for targets with a fixed set of codecs.
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

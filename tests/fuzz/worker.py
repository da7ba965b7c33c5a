"""One target under atheris, as a process: `python -m fuzz.worker frames [options of libFuzzer]`.

Only bus and busd are instrumented: what is covered is what belongs to us. And what uses the native core, of
which nothing is seen here.
"""

import sys

import atheris  # type: ignore[import-untyped, import-not-found, unused-ignore]

with atheris.instrument_imports(include=["bus", "busd", "fuzz.hostile_ring"]):
    from fuzz.targets import TARGETS

name = sys.argv.pop(1)
atheris.Setup(sys.argv, TARGETS[name])
atheris.Fuzz()

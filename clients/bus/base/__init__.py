"""Small helpers that know nothing about the bus and its errors. All other packages may import them.

Each module stands alone: descriptors (`descriptor.py`), memory by the page (`buffers.py`), kinds of callbacks
(`callbacks.py`), warnings about a forgotten `await` (`awaited.py`), texts that are safe to print
(`printable.py`), "did you mean ...?" (`suggest.py`, `missing_names.py`), quick imports, safe from a
Ctrl-C (`loading.py`), modules that are loaded at their first use (`late_modules.py`) and so on.

Invariants:

- Nothing here imports another package of `bus`. import-linter checks this.
- `loading.py` loads no module except `late_modules.py`: a Ctrl-C could interrupt that import.
- `suggest.py` and `missing_names.py` are only needed after mistakes, so they are imported late.
- `printable.py` has the list of escaped characters in texts of other processes, for all tools.

Read first: the docstring of the module in question.

Tests: `tests/unit/bus/base/`, `tests/system/test_awaited.py`, `tests/system/test_early_signals.py`.
"""

"""Imports asyncio without its rarely needed modules, TLS and `inspect`. An import of this module is enough.

These modules can still be imported, by asyncio and by all other code. Each is loaded at the first access to
one of its names. They need about a fifth of asyncio's time and memory. uvloop accesses such names at once, so
this only helps programs on other loops. Owns the list of these modules, and the way to load a module late.
`importlib.util.LazyLoader` would load a module as soon as it is imported again, and is not safe for threads.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from threading import RLock
from types import ModuleType
from typing import Any, Final

__all__: list[str] = []

_LATE: Final = frozenset(("asyncio.sslproto", "inspect", "ssl"))
_NEEDED: Final = {"ssl": "_ssl"}
"""Modules that a Python may lack: then asyncio must get the ImportError at once."""

_lock: Final = RLock()
"""Held while a module is loaded: other threads wait for its names."""


class _Late(ModuleType):
    """A module that is not loaded yet; after loading it is a plain module."""

    def __getattr__(self, name: str) -> Any:
        _load(self)
        return ModuleType.__getattribute__(self, name)

    def __setattr__(self, name: str, value: object) -> None:
        _load(self)  # else loading would overwrite the value
        ModuleType.__setattr__(self, name, value)

    def __dir__(self) -> list[str]:
        _load(self)
        return sorted(vars(self))


class _Loader:
    """Defers the work to `loader`."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader

    def create_module(self, spec: ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        module.__class__ = _Late


class _Finder:
    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in _LATE or (name in _NEEDED and PathFinder.find_spec(_NEEDED[name]) is None):
            return None
        spec = PathFinder.find_spec(name, path)
        if spec is not None:
            spec.loader = _Loader(spec.loader)  # type: ignore[assignment]
        return spec


def _load(module: ModuleType) -> None:
    with _lock:
        spec: Any = module.__spec__
        late = spec.loader
        if not isinstance(late, _Loader):
            return  # it is loaded, or this thread is just loading it
        names = vars(module)
        spec.loader = names["__loader__"] = late.loader
        try:
            late.loader.exec_module(module)
        except BaseException:
            spec.loader = names["__loader__"] = late
            raise
        module.__class__ = ModuleType


if "asyncio" not in sys.modules:
    sys.meta_path.insert(0, _Finder)
    try:
        import asyncio  # noqa: F401
    finally:
        sys.meta_path.remove(_Finder)

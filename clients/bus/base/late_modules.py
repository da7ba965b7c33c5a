"""Modules that asyncio, uvloop and msgspec import, but few programs use: loaded at their first use.

TLS, `inspect` and the like need a fifth of the time and memory of a start. While a block of `late_modules`
runs, an import of such a module makes a late one, which is loaded at the first access to one of its names.
They can still be imported, by any code. `bus.base.loading` has the block for imports; nothing else uses this
module.

uvloop and `uuid` take some names of these modules at once. During the block they get a stand-in that does the
same: the C core's own object, or a function that loads the module when it is called.

Owns: the list of these modules and of the stand-ins, and the way to load a module late.
`importlib.util.LazyLoader` would load a module as soon as it is imported again, and is not safe for threads.

Must not load any module, as `bus.base.loading`.
"""

from __future__ import annotations

import sys
from _frozen_importlib import ModuleSpec  # as in importlib.machinery, which may not be loaded
from _frozen_importlib_external import PathFinder
from _thread import RLock, get_ident

TYPE_CHECKING = False  # without an import of `typing`, which takes a while
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import ModuleType
    from typing import Any, Final
else:
    ModuleType = type(sys)

__all__ = ["late_modules", "when_loaded"]

_LATE: Final = frozenset(
    (
        "asyncio.sslproto",
        "inspect",
        "locale",
        "msgspec.inspect",
        "platform",
        "selectors",
        "ssl",
        "subprocess",
        "textwrap",
        "tokenize",
    )
)
_NEEDED: Final = {"ssl": "_ssl"}
"""Modules that a Python may lack: then asyncio must get the ImportError at once."""

_COROUTINE: Final = 0x80
"""`inspect.CO_COROUTINE`, the flag of the code of an `async def`."""

_lock: Final = RLock()
"""Held while a module is loaded: other threads wait for its names."""

_importing: Final[list[int]] = []
"""The threads that run a block, one entry for each block."""


class late_modules:
    """A block in which imports of these modules are late."""

    def __enter__(self) -> None:
        _importing.append(get_ident())
        sys.meta_path.insert(0, _Finder)

    def __exit__(self, *_: object) -> None:
        sys.meta_path.remove(_Finder)
        _importing.remove(get_ident())


def when_loaded(module: ModuleType, call: Callable[[], None]) -> None:
    """Call `call` once `module` is loaded: now, or at the end of its loading."""
    with _lock:
        if isinstance(module, _Late):
            loader: Any = module.__spec__ and module.__spec__.loader
            loader.calls.append(call)
            return
    call()


class _Late(ModuleType):
    """A module that is not loaded yet; after loading it is a plain module."""

    def __getattr__(self, name: str) -> Any:
        if get_ident() in _importing and (self.__name__, name) in _STAND_INS:
            return _STAND_INS[self.__name__, name]()
        _load(self)
        return ModuleType.__getattribute__(self, name)

    def __setattr__(self, name: str, value: object) -> None:
        _load(self)  # else loading would overwrite the value
        ModuleType.__setattr__(self, name, value)

    def __dir__(self) -> list[str]:
        _load(self)
        return sorted(vars(self))


class _Loading(ModuleType):
    """A module that a thread is just loading: other threads wait for all its names, as in an import.

    A function that already exists may call another one that does not exist yet.
    """

    def __getattribute__(self, name: str) -> Any:
        if not name.startswith("__"):  # importlib and `isinstance` ask for the others
            with _lock:
                pass
        return ModuleType.__getattribute__(self, name)

    def __setattr__(self, name: str, value: object) -> None:
        with _lock:
            ModuleType.__setattr__(self, name, value)


class _Loader:
    """Defers the work to `loader`; `calls` come after it."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader
        self.calls: list[Callable[[], None]] = []

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
        module.__class__ = _Loading
        try:
            late.loader.exec_module(module)
        except BaseException:
            module.__class__ = _Late
            spec.loader = names["__loader__"] = late
            raise
        module.__class__ = ModuleType
        for call in late.calls:
            call()


def _function(module: str, name: str) -> Callable[[], Any]:
    """A stand-in for a function, or for an exception that is only raised: a call loads the module."""

    def call(*args: Any, **named: Any) -> Any:
        _load(sys.modules[module])
        return getattr(sys.modules[module], name)(*args, **named)

    call.__name__ = call.__qualname__ = name
    return lambda: call


def _is_coroutine_function(what: Any) -> bool:
    """`inspect.iscoroutinefunction`: uvloop calls it for each signal handler, mostly a plain function."""
    if type(what) is type(_load) and not (what.__code__.co_flags & _COROUTINE or vars(what)):
        return False
    _load(sys.modules["inspect"])
    return bool(sys.modules["inspect"].iscoroutinefunction(what))


class _TypeCheck:
    """The signature of `typing._type_check`, as far as `typing_extensions` asks for it."""

    def __init__(self, function: Any) -> None:
        self.parameters = function.__code__.co_varnames


def _signature(what: Any) -> Any:
    """`inspect.signature`: `typing_extensions` asks at once whether `typing._type_check` has a parameter."""
    if what is sys.modules["typing"]._type_check:
        return _TypeCheck(what)
    _load(sys.modules["inspect"])
    return sys.modules["inspect"].signature(what)


def _of_core(name: str) -> Callable[[], Any]:
    """An object that `ssl` takes from its C core."""

    def take() -> Any:
        import _ssl

        return getattr(_ssl, name)

    return take


class _ContextType(type):
    def __instancecheck__(cls, instance: object) -> bool:
        _load(sys.modules["ssl"])
        return isinstance(instance, sys.modules["ssl"].SSLContext)


class _SSLContext(metaclass=_ContextType):
    """Stands for the class `ssl.SSLContext`, of which uvloop only asks whether an object has it."""


def _system() -> str:
    """`platform.system()`: `uuid` calls it at once."""
    import os  # Python's start has loaded it

    return os.uname().sysname


_STAND_INS: Final[dict[tuple[str, str], Callable[[], Any]]] = {
    ("inspect", "iscoroutinefunction"): lambda: _is_coroutine_function,
    ("inspect", "isgenerator"): _function("inspect", "isgenerator"),
    ("inspect", "signature"): lambda: _signature,
    **({("platform", "system"): lambda: _system} if sys.platform == "linux" else {}),
    ("subprocess", "DEVNULL"): lambda: -3,
    ("subprocess", "PIPE"): lambda: -1,
    ("subprocess", "STDOUT"): lambda: -2,
    ("subprocess", "SubprocessError"): _function("subprocess", "SubprocessError"),
    ("ssl", "create_default_context"): _function("ssl", "create_default_context"),
    ("ssl", "CertificateError"): _of_core("SSLCertVerificationError"),
    ("ssl", "SSLContext"): lambda: _SSLContext,
    **{
        ("ssl", name): _of_core(name)
        for name in (
            "MemoryBIO",
            "SSLError",
            "SSLSyscallError",
            "SSLWantReadError",
            "SSLZeroReturnError",
            "SSL_ERROR_SYSCALL",
            "SSL_ERROR_WANT_READ",
            "SSL_ERROR_WANT_WRITE",
        )
    },
}
"""What a block gets for a name of a late module."""

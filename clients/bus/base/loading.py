"""Imports of the bus's modules: quick, and safe from a Ctrl-C.

All late imports that need a while are in a block of `loading`. It defers SIGINT, keeps the garbage collector
off, and lets asyncio, uvloop and msgspec load rarely used modules later (`late_modules.py`).

An import is a bad moment for a KeyboardInterrupt. CPython drops it in the callback that removes an import
lock ("Exception ignored in ... cb"), and the program continues. In other places it becomes a SyntaxError or a
RuntimeError of the loading module. So `import bus` and its later imports defer SIGINT until the modules are
loaded. Not deferred: the body of a message package, and the end of the program's own `import`.

No traceback is printed for a KeyboardInterrupt that came meanwhile: it would only show loading modules.

Must not load any module: a Ctrl-C would not be deferred then.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found] # built into Python, as the next ones: nothing is loaded
import gc
import sys

from bus.base.late_modules import late_modules

TYPE_CHECKING = False  # without an import of `typing`, which takes a while
if TYPE_CHECKING:
    from types import FrameType, TracebackType

__all__ = ["deferred_interrupts", "except_hook", "hide_tracebacks_of_imports", "keep_frozen", "loading"]

_is_frozen = False
"""Whether `bus.run` has frozen the objects of all imports so far."""


class deferred_interrupts:
    """A block in which a Ctrl-C waits: its KeyboardInterrupt is raised at the end of the block.

    It has no effect in threads other than the main one, in an inner block, and if the program has a handler
    for SIGINT or ignores it.
    """

    def __init__(self) -> None:
        self._is_first = self._came = False

    def __enter__(self) -> None:
        if _signal.getsignal(_signal.SIGINT) is not _signal.default_int_handler:
            return
        try:
            _signal.signal(_signal.SIGINT, self._note)
        except ValueError:  # not the main thread
            return
        self._is_first = True

    def __exit__(self, *_: object) -> None:
        if not self._is_first:
            return
        if _signal.getsignal(_signal.SIGINT) == self._note:  # a module may have set another handler
            _signal.signal(_signal.SIGINT, _signal.default_int_handler)
        if self._came:
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._came = True


class loading(deferred_interrupts):
    """A block of imports. An inner block has no effect."""

    def __enter__(self) -> None:
        super().__enter__()
        self._late = late_modules()
        self._late.__enter__()
        self._modules = len(sys.modules)
        # The collector would check all modules several times, and find nothing.
        self._collects = gc.isenabled()
        gc.disable()

    def __exit__(self, *error: object) -> None:
        if self._collects:
            if len(sys.modules) == self._modules:
                pass  # usual later: a program has all modules, and to count its frozen objects can take 10 ms
            elif _is_frozen:
                gc.freeze()
            elif not gc.get_freeze_count():  # else the program has frozen objects, which must stay frozen
                gc.freeze()
                gc.unfreeze()  # now the modules belong to the oldest generation, without a collection
            gc.enable()
        self._late.__exit__()
        super().__exit__(*error)


def keep_frozen(is_frozen: bool) -> None:
    """Let later blocks freeze what they load, as the caller has done with all objects so far; or no more."""
    global _is_frozen
    _is_frozen = is_frozen


def hide_tracebacks_of_imports() -> None:
    """Install `except_hook`, unless the program has its own hook."""
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = except_hook


def except_hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """As Python's hook, but without the traceback of a KeyboardInterrupt from an import of the bus's modules.

    Python then ends the program by SIGINT, as for any uncaught KeyboardInterrupt.
    """
    if kind is not KeyboardInterrupt or hasattr(sys, "ps1") or not _is_loading(trace):
        sys.__excepthook__(kind, error, trace)


def _is_loading(trace: TracebackType | None) -> bool:
    """Whether a KeyboardInterrupt came from an import of a bus module; `bus` itself and this module only
    import."""
    while trace is not None:
        frame = trace.tb_frame
        module = frame.f_globals.get("__name__", "")
        if module in ("bus", __name__) or (frame.f_code.co_name == "<module>" and _is_ours(module)):
            return True
        if module == "importlib._bootstrap" and _is_ours(frame.f_locals.get("name")):
            return True
        trace = trace.tb_next
    return False


def _is_ours(module: object) -> bool:
    root = module.partition(".")[0] if isinstance(module, str) else ""
    return root == "bus" or root.startswith("bus_")

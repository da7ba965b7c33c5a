"""The shared-memory route's own part: rings, readers' segments, doorbells. See docs/ring.md.

Owns the segments and the native core, which is imported when it is asked for. Must not know the wire, the
loop, or who matches with whom.
"""

import os
import sys
from importlib import import_module
from types import ModuleType

__all__ = ["core", "is_available", "why_not"]

_CORE = "bus.shm._core"


def core() -> ModuleType:
    """The native core, as `_core.pyi` describes it. Raises ImportError where it was not built."""
    return import_module(_CORE)


def is_available() -> bool:
    """Whether this process may and can share memory. Looks at the environment anew each time."""
    return not why_not()


def why_not() -> str:
    """Why all goes by socket, in a few words; "" where memory can be shared."""
    if os.environ.get("BUS_ROUTE") == "socket":
        return "BUS_ROUTE=socket is set"
    if os.environ.get("BUS_NATIVE") == "no":
        return "BUS_NATIVE=no is set"
    if sys.platform != "linux":
        return f"shared memory needs Linux, this is {sys.platform}"
    try:
        core()
    except ImportError as error:
        return f"the native core was not built ({error})"
    return ""


def _forked() -> None:
    if _CORE in sys.modules:
        core().forget_pins()  # views that the child inherited must not release the parent's


os.register_at_fork(after_in_child=_forked)

"""Shared memory: rings, readers' segments, doorbells, and the native core in C. See docs/ring.md.

Owns the segments and the native core. The first use of `shm.native` imports the core, and raises ImportError
if it was not built. Must not know the wire, the loop, or which endpoints match.

    Python   `segments.py` (make segments), `descriptors.py` (check received descriptors),
             `headroom.py` (free memory), `openfiles.py` (numbers of descriptors)
    binding  `py.h`, py_*.c: one file for each type; `_core.pyi` has their types
             `py_fields.c` makes messages of rclpy, without shared memory
    C        `ring.h`, `writer.h`, `reader.h`, `feed.h`, `gates.h`, `doorbell.h`: the algorithm, no Python;
             `sizes.h`: sizes of rings

Invariants:

- Python never reads or writes words that another process may change; only the C core does, with atomics.
- There is no lock, and no wait for another process. If a process is killed at any instruction, the others
  continue.
- Bytes that may change are copied and then validated, or their record is pinned first.
- A segment has no name. Its memory is reserved when it is made, and it is sealed before another process gets
  it. Only its maker can write it.
- `descriptors.py` checks a descriptor of another process before it is mapped. The core checks the contents.
- Without the core, everything works by socket.

Read first: docs/ring.md, then `layout.h` and `ring.h`.

Tests: `tests/unit/bus/shm/`, `tests/native/` (`make native`, `make sanitize`),
`tests/property/test_ring_gates.py`, `tests/fuzz/`.
"""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

__all__ = ["advice", "has_core", "is_available", "native", "turned_off_by", "why_not"]

_CORE = "bus.shm._core"
_OFF = {"BUS_ROUTE": "socket", "BUS_NATIVE": "no"}

if TYPE_CHECKING:
    from bus.shm import _core as native
else:

    def __getattr__(name: str) -> object:
        if name != "native":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = core = import_module(_CORE)
        return core


def has_core() -> bool:
    """Whether the native core was built and this process may use it."""
    if os.environ.get("BUS_NATIVE") == _OFF["BUS_NATIVE"]:
        return False
    try:
        return bool(sys.modules.get(_CORE) or import_module(_CORE))
    except ImportError:
        return False


def is_available() -> bool:
    """Whether this process may and can share memory. Each call reads the environment anew."""
    return not why_not()


def why_not() -> str:
    """The reason why this process only uses the socket route, in a few words; "" if it can share memory."""
    if name := turned_off_by():
        return f"{name}={_OFF[name]} is set"
    if sys.platform != "linux":
        return f"shared memory needs Linux, this is {sys.platform}"
    try:
        import_module(_CORE)
    except ImportError as error:
        if _is_free_threaded():
            return "the native core needs a Python with the GIL, and this one is free-threaded"
        return f"the native core was not built ({error})"
    return ""


def turned_off_by() -> str:
    """The environment variable that turns shared memory off, or ""."""
    return next((name for name, value in _OFF.items() if os.environ.get(name) == value), "")


def advice() -> str:
    """The remedy for the reason of `why_not`; "" if there is no reason, or no remedy."""
    if name := turned_off_by():
        return f"unset {name}"
    if sys.platform != "linux" or not why_not():
        return ""
    if _is_free_threaded():
        return "run it with a Python that has the GIL"
    return "install a C compiler, then busd again from its sources with BUS_NATIVE=yes"


def _is_free_threaded() -> bool:
    return "t" in sys.abiflags


def _forked() -> None:
    if core := sys.modules.get(_CORE):
        core.forget_pins()  # views that the child inherited must not release the parent's pins


os.register_at_fork(after_in_child=_forked)

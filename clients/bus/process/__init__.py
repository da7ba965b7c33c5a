"""Parts of a process, with or without a bus: arguments, signals, a log file, loops that threads share.

- The path of busd's socket: `address.py` (pure: computes a path, touches no file).
- Command line and files: `ros_args.py` (ROS arguments), `tables.py` (tables of busd.toml).
- Ends: `termination.py` (a program dies by the signal that ended it), `start_errors.py` (errors of the start
  in one line), `mistakes.py` (texts for common mistakes).
- Event loops: `shared_loop.py` (a loop with a lock, the guard, for several threads), `foreground.py` (a loop
  that runs only while a call waits), `waiters.py` (tasks that wait for a change).
- `logfile.py`: the log of a busd in the background.

Invariants:

- No module here communicates with busd, or knows nodes and messages.
- A caller of the shared loop holds the guard whenever it touches the loop or anything on it. The thread that
  runs the loop releases the guard only while it waits for events.
- A file is renamed or emptied as a log only if it begins with busd's mark and belongs to this user.
- `tables.py` and `mistakes.py` are slow to import, so they are imported late.

Read first: the docstring of the module in question; the modules are independent. For threads:
`shared_loop.py`.

Tests: `tests/unit/bus/process/`, `tests/system/test_early_signals.py`, `tests/system/test_endings.py`,
`tests/system/test_background_log.py`.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

    from bus.process.shared_loop import GuardedLoop

__all__ = ["guarded"]


def guarded(loop: AbstractEventLoop) -> GuardedLoop | None:
    """`loop`, if threads share it; else None. Does not import `shared_loop.py`, which few programs need."""
    kind = getattr(sys.modules.get("bus.process.shared_loop"), "GuardedLoop", ())
    return loop if isinstance(loop, kind) else None

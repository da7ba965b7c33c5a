"""Calls at times of the monotonic clock, on an event loop, to some ten microseconds.

Timers and rates of a node use this, and a bag's player. The timers of asyncio and uvloop count whole
milliseconds: periods below one miss calls, or poll without sleep.

    `loop_alarms.py` (Alarms) --+-- `schedule.py`   which call comes next; pure
                                +-- `wake_up.py`    a timerfd of the kernel, or the loop's timers without one

Invariants:

- All users of an event loop share one `Alarms`, got with `acquire` and given back with `release`. So a
  process has one timer of the kernel for each loop.
- `schedule.py` knows no clock and no event loop. Adding costs O(log n), cancelling O(1).

Read first: `schedule.py`. Tests: `tests/unit/bus/alarms/`, `tests/unit/bus/test_timer.py`.
"""

from bus.alarms.loop_alarms import Alarms
from bus.alarms.schedule import Alarm

__all__ = ["Alarm", "Alarms"]

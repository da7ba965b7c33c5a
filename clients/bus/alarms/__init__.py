"""Calls at times of the monotonic clock, on an event loop, to some ten microseconds.

Timers and rates of a node use this, and a bag's player. The timers of asyncio and uvloop count whole
milliseconds: periods below one miss calls, or poll without sleep.

Pure: which call comes next (`schedule`). Shells: one timer of the kernel for each event loop (`wake_up`), and
both put together (`loop_alarms`).
"""

from bus.alarms.loop_alarms import Alarms
from bus.alarms.schedule import Alarm

__all__ = ["Alarm", "Alarms"]

"""The daemon as a process: its log, its service manager, its restart.

- `logs.py`: lines on stderr, written by a thread; `repetitions.py`: lines that repeat.
- `sd_notify.py`: tells a service manager that busd is ready, reloads or stops.
- `restart.py`: the same process runs the program again and keeps the listening socket.

Invariants:

- busd never waits for a reader of its log. Lines that find no room are dropped and counted.
- A line that repeats the one before within ten seconds gets the level DEBUG, so a program can't flood the
  log.
- A restart checks first whether the new program can start. If it can't, busd stays as it is.

Read first: the module in question; they are independent.

Tests: `tests/unit/busd/process/`, `tests/system/test_stuck_log.py`, `tests/system/test_handover.py`.
"""

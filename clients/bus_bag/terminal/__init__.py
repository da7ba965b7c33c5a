"""The terminal of a recorder or player: its keys, and a line below the log.

`keyboard.py` reads keys on the event loop. `status_line.py` rewrites the line of progress. `foreground.py`
checks whether the program owns its terminal now.

Invariants:

- The mode of the terminal is restored at every end or stop of the program (Ctrl-Z included).
- A program in the background does not touch the terminal.
- This package does not know the meaning of keys: see `clients/bus_bag/play/keys.py`.

Read first: `keyboard.py`. Tests: `tests/system/test_bag_keys.py`, `tests/system/test_terminal.py`.
"""

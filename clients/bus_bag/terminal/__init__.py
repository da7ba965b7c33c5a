"""The terminal of a recorder or player: its keys, and a line below the log.

`keyboard.py` reads keys on the event loop, `status_line.py` rewrites the line of progress, `foreground.py`
says whether the program owns its terminal now.

Invariants:

- The mode of the terminal is restored whatever ends the program or stops it (Ctrl-Z included).
- A program in the background does not touch the terminal.
- What a key means is not known here: see `clients/bus_bag/play/keys.py`.

Read first: `keyboard.py`. Tests: `tests/system/test_bag_keys.py`, `tests/system/test_terminal.py`.
"""

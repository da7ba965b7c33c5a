"""Verbs of `bus action`.

`send_goal.py` opens a node, with a client of `bus_actions`; the others ask once. `definitions.py` has types
by name, and names for the shell.

Invariants: lines are those of `ros2 action`; Ctrl-C cancels the goal before the program ends.

Read first: `definitions.py`. Tests: `tests/system/test_cli_action.py`.
"""

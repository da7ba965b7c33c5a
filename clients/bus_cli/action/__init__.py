"""Verbs of `bus action`.

`send_goal.py` opens a node with a client of `bus_actions`. The other verbs ask busd one question.
`definitions.py` finds types by name, and completes names in the shell.

Invariants: verbs print the same lines as `ros2 action`; Ctrl-C cancels the goal before the program ends.

Read first: `definitions.py`. Tests: `tests/system/test_cli_action.py`.
"""

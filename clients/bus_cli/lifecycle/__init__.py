"""Verbs of `bus lifecycle`.

`remote.py` finds lifecycle nodes and calls their services; every verb uses it.

Invariants: lines and the names of states and transitions are the same as in `ros2 lifecycle`.

Read first: `remote.py`. Tests: `tests/system/test_cli_lifecycle.py`.
"""

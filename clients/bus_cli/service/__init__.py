"""Verbs of `bus service`.

`call.py` opens a node; the others ask once. `definitions.py` has types by name, and names for the shell.

Invariants: lines are those of `ros2 service`; the type may come from a definition file or from the bus.

Read first: `definitions.py`. Tests: `tests/system/test_cli_service.py`.
"""

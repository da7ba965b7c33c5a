"""Verbs of `bus service`.

`call.py` opens a node. The other verbs ask busd one question. `definitions.py` finds types by name, and
completes names in the shell.

Invariants: verbs print the same lines as `ros2 service`; the type may come from a definition file or from
the bus.

Read first: `definitions.py`. Tests: `tests/system/test_cli_service.py`.
"""

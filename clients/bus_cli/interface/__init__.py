"""`bus interface`: the definitions of messages, services and actions. It needs no daemon.

`list.py` and `show.py` also have the options that the other verbs use. `bus.types.definitions` finds and
reads the definitions.

Invariants: verbs print the same lines as `ros2 interface`; no verb connects to busd.

Read first: `show.py`. Tests: `tests/system/test_cli_interface.py`.
"""

"""`bus interface`: the definitions of messages, services and actions. No daemon is needed for them.

`list.py` and `show.py` also have the options that the other verbs use. Definitions are found and read by
`bus.types.definitions`.

Invariants: lines are those of `ros2 interface`; nothing connects to busd.

Read first: `show.py`. Tests: `tests/system/test_cli_interface.py`.
"""

"""Verbs of `bus topic`.

`list.py`, `info.py`, `find.py` and `type.py` ask once (`bus_cli.query`). `echo.py`, `hz.py`, `bw.py`,
`delay.py` and `pub.py` stay (`bus_cli.stream`). What hz, bw and delay compute is in `bus_cli.stats`.

Invariants: lines are those of `ros2 topic`; a subscription takes the QoS that the publishers offer, unless
options say otherwise (`bus_cli.qosargs`); types are found on the bus, so none need to be installed.

Read first: `hz.py`. Tests: `tests/system/test_cli_echo.py`, `tests/system/test_cli_pub.py`,
`tests/system/test_cli_rates.py`, `tests/system/test_cli_query.py`.
"""

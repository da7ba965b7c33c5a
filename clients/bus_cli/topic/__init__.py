"""Verbs of `bus topic`.

`list.py`, `info.py`, `find.py` and `type.py` ask busd one question (`bus_cli.query`). `echo.py`, `hz.py`,
`bw.py`, `delay.py` and `pub.py` keep running (`bus_cli.stream`). `bus_cli.stats` has the calculations of hz,
bw and delay.

Invariants: verbs print the same lines as `ros2 topic`. Without options, a subscription uses the QoS that the
publishers offer (`bus_cli.qosargs`). Types come from the bus, so none need to be installed.

Read first: `hz.py`. Tests: `tests/system/test_cli_echo.py`, `tests/system/test_cli_pub.py`,
`tests/system/test_cli_rates.py`, `tests/system/test_cli_query.py`.
"""

"""Verbs of `bus node`.

Both ask busd for the graph once (`bus_cli.query`), without an event loop. Lines are those of `ros2 node`.

Read first: `list.py`. Tests: `tests/system/test_cli_query.py`.
"""

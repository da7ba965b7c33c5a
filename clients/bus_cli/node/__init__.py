"""Verbs of `bus node`.

Both ask busd for the graph once (`bus_cli.query`), without an event loop. They print the same lines as
`ros2 node`.

Read first: `list.py`. Tests: `tests/system/test_cli_query.py`.
"""

"""Warnings about problems at run time, with bounds for the log.

- `bursts.py`: messages were lost because a program published without a pause.
- `slow_callback.py`: a callback has blocked the event loop.
- `mismatch.py`: for tools, the reason why a publisher and a subscription in the graph don't match.
- `provoked.py`: limits for warnings that other processes can cause.

Invariants:

- A warning adds no cost to a message: it reads counters that exist anyway, or times a call at its place.
- Another process can't flood the log. A warning that other processes can cause goes through `provoked.py`.
- A text names the topic, node or callback, and a remedy.

Read first: `provoked.py`.

Tests: `tests/unit/bus/diagnostics/`, `tests/system/test_bursts.py`, `tests/system/test_slowcallback.py`,
`tests/system/test_cli_hints.py`.
"""

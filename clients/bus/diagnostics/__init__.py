"""Warnings about problems at run time, limited to what a log can bear.

- `bursts.py`: messages were lost because a program published without a pause.
- `slow_callback.py`: a callback has blocked the event loop.
- `mismatch.py`: why a publisher and a subscription don't match, in busd's words.
- `provoked.py`: limits for warnings that other processes can cause.

Invariants:

- A warning costs a message nothing: it reads counters that exist anyway, or times a call where it is made.
- Another process can't flood the log. A warning that other processes can cause goes through `provoked.py`.
- A text names the thing (topic, node, callback) and what would help.

Read first: `provoked.py`.

Tests: `tests/unit/bus/diagnostics/`, `tests/system/test_bursts.py`, `tests/system/test_slowcallback.py`,
`tests/system/test_cli_hints.py`.
"""

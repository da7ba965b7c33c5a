"""Nodes for scripts, and their publishers and subscriptions: every call waits until it is done.

    script -> `node.py`, `endpoint.py` -> `bus.process.foreground` (the loop, while a call waits) -> bus.Node

Invariants:

- There is no thread. Between two calls nothing runs; new messages wait in the rings and in the socket.
- After a wake-up the message comes first, all other work of the loop later.
- Ctrl-C ends a waiting call, after the present step.
- Each object here wraps one of the library (`bus.Node`, Publisher, Subscription) and adds no semantics.

Read first: `node.py`. Tests: `tests/unit/bus/blocking/`, `tests/system/test_blocking.py`,
`tests/system/test_scripts.py`, `tests/unit/bus/process/test_foreground.py`.
"""

from bus.base.loading import loading

with loading():
    from bus.blocking.endpoint import BlockingPublisher, BlockingSubscription
    from bus.blocking.node import BlockingNode, connect

__all__ = ["BlockingNode", "BlockingPublisher", "BlockingSubscription", "connect"]

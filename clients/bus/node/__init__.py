"""The node, its open endpoints and its log.

    `node.py` (Node) --+-- `endpoints.py`    publishers and subscriptions that are open; their end
                       +-- `graph_host.py`   methods about the graph (a base class)
                       +-- `rosout.py`       log lines on /rosout
                       +-- `unclosed.py`     warnings about nodes that are never closed
    parameters and time: `bus.parameters`, also by a base class

Invariants:

- A node closes everything that it has made. After that it owns no descriptor, task or timer.
- A node declares itself first, then its publisher of /rosout, and does not wait for the answer to the latter.
- Creation of an endpoint returns only when busd has declared it and told others (the first-message
  guarantee).
- Modules that few programs need are imported late, because each import delays a program's first message:
  `tests/system/test_first_message.py` lists what may be imported.

Read first: `node.py`.

Tests: `tests/unit/bus/node/`, `tests/system/test_node.py`, `tests/system/test_unclosed.py`,
`tests/system/test_watch_graph.py`.
"""

from bus.node.node import SERVICE_QOS, Node

__all__ = ["SERVICE_QOS", "Node"]

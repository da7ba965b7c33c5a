"""The connection of an event loop to busd: declarations, requests, reconnection, messages for endpoints.

    endpoints, nodes
        |
    `link.py` ------- `incoming.py` (busd to endpoints), `observing.py` (the graph), `reports.py` (counters)
        |
    `connecting.py` -- `declarations.py` (nodes and endpoints, declared again after each reconnection)
        |
    `connection.py` -- `requests.py`, `heartbeat.py`
        |
    `reach.py` (connect, try again) -- `autostart.py` (start a busd), `socket_owner.py` (is the socket safe?)

`shm_context.py` has the doorbell and the readers' segment that this process shares with others.

Invariants:

- Nodes of one event loop that use the same socket share one `Link`. A `Link` survives the end of busd. A
  `Connection` does not: it ends with the first loss, and a new one replaces it.
- Ids come from busd and are new after a reconnection. The gid of an endpoint never changes.
- After a reconnection everything is declared again before samples flow. Programs only notice a pause.
- A request has one answer or one error. busd counts as hung if an answer is due and it has sent nothing at
  all for some time.
- An exception in a user's callback does not stop the delivery of other messages of the same read.
- The link belongs to the thread of its event loop. Only `publish` may be called by other threads.

Read first: `link.py`, then `connecting.py`.

Tests: `tests/unit/bus/link/`, `tests/system/test_link.py`, `tests/system/test_reconnection.py`,
`tests/system/test_recovery.py`, `tests/system/test_autostart.py`.
"""

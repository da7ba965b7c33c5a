"""The shell around the core: the socket, connections, turns, effects, the end.

    `listener.py` -> `admission.py` (until Hello) -> `peer.py` -> `serving.py` (turns) -> busd.core
    sockets <- `peer.py` <- `effect_runner.py` <------------------------------- effects <-------+

`passing.py` is the short way of a run that needs no queue. `life.py` has the states of busd as a table,
`shutdown.py` the order of the end. `server.py` puts all together.

Invariants:

- No module here decides about routes, matches or rights: the core does.
- Effects are carried out in their order; clients rely on it.
- A socket is read only when its process has its turn, and not while the process takes no data from busd.
- A connection before its Hello has one of a fixed number of places, never a peer's.
- Descriptors are checked before the core sees them. Threads close descriptors whose
  closing may block (`strangers.py`).
- One busd serves a path: it holds the lock beside the socket (`listener.py`).

Read first: `serving.py`, then `peer.py` and `effect_runner.py`.

Tests: `tests/unit/busd/server/`, `tests/system/test_turns.py`, `tests/system/test_door.py`,
`tests/system/test_drain.py`, `tests/system/test_handover.py`, `tests/system/test_descriptors.py`.
"""

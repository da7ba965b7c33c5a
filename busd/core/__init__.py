"""The broker as a pure state machine: values in, effects out. No I/O, no clock, no event loop.

    message, run, time --> `broker.py` --+-- `entrance.py`    which processes may connect
                                         +-- `registry.py`    nodes and endpoints come and go
                                         +-- `matching.py`    which match; `match.py`: the states of a match
                                         +-- `router.py`      runs into queues
                                         +-- `shm_routes.py`  which ring each process reads
                                         +-- `queries.py`     the graph, types, peers
                                         v
                              effects (`effects.py`), in order

`graph.py` and `entities.py` have the tables. docs/architecture.md, "The broker", lists all modules.

Invariants:

- Time comes in as an argument; nothing here reads a clock or touches a socket. import-linter checks this.
- A mistake of a peer becomes Refused, or Fault and Disconnect. An exception out of the broker is a bug.
- All work is counted (`work.py`). Work that may take long is a generator and goes on in later turns of the
  process that caused it. A handler without an entry in `tests/unit/busd/core/test_work_budget.py` fails it.
- Everything that a peer can make busd hold is counted for the peer and its user, and bounded (`quotas.py`).
- Each lost sample is counted once, with a reason, for the subscription that lost it.
- A match changes its state only by the table in `match.py`.
- The router never decodes a payload and pays per run, not per sample.

Read first: `broker.py`, `effects.py`, `match.py`.

Tests: `tests/unit/busd/core/` (by `tests/world/broker_world.py`), `tests/property/test_broker_model.py`,
`tests/property/test_whole_bus.py`, `tests/fuzz/`.
"""

"""The bridge without its engine: which nodes and topics are mirrored, and how messages are carried.

    out  graph -> `local_graph.py` -> `announcing.py` -> engine
         messages -> `taps.py` -> `exports.py` -> `export.py` (`waiting.py`, `pace.py`) -> the engine's Writer
    in   engine -> `far_graph.py` (`bounds.py`, `rules.py`) -> `mirrors.py` -> nodes on this bus
         the engine's Reader -> `far_reading.py` -> `imports.py` -> `publishing.py` -> mirror

`continuity.py` decides which messages are new, repeated or lost, by a table (docs/architecture.md,
"Bridges"). `bridge.py` puts all together; `reporting.py` and `status.py` show counters.

Invariants:

- Pure modules (see docs/architecture.md) get times as arguments and do no I/O.
- Each way has an account that closes (`accounts.py`): taken = sent + waiting + dropped by reason.
- A message is neither lost nor repeated because a tap, a reader, busd or a link was replaced:
  `continuity.py`.
- Mirrors follow the `FarGraph`. One task makes and closes them, so however fast the far side changes, nothing
  piles up.
- What came from a bus never goes back to it; mirrors are not mirrored again, except for topics with
  `transit`.
- Subscriptions are announced before publishers, so that the first message finds them.

Read first: `bridge.py`, `continuity.py`, then `export.py` and `imports.py`.

Tests: `tests/unit/bus_bridge/core/`, `tests/system/test_bridge_core.py`, `tests/system/test_bridge_loops.py`,
`tests/system/test_bridge_three.py`.
"""

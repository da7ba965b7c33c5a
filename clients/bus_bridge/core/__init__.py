"""The bridge without its engine: chooses the nodes and topics to mirror, and carries messages.

    out  graph -> `local_graph.py` -> `announcing.py` -> engine
         messages -> `taps.py` -> `exports.py` -> `export.py` (`waiting.py`, `pace.py`) -> the engine's Writer
    in   engine -> `far_graph.py` (`bounds.py`) -> `mirrors.py` -> nodes on this bus
         the engine's Reader -> `far_reading.py` -> `imports.py` -> `publishing.py` -> mirror
         where routes ended, for publishers that come back: `pasts.py`; for the next process: `journal.py`

What crosses, by which name and QoS: `rules.py`, `naming.py`, `qos_rule.py`.

New rules come by `Bridge.reconfigure`: unchanged parts keep their objects, so their mirrors and routes stay.

`continuity.py` decides which messages are new, repeated or lost, by a table (docs/architecture.md,
"Bridges"). `bridge.py` connects all parts; `reporting.py` and `status.py` show counters.

Invariants:

- Pure modules (see docs/architecture.md) get times as arguments and do no I/O.
- The counters of each route add up (`accounts.py`): taken = sent + waiting + dropped by reason.
- No message is lost or repeated if a tap, a reader, busd or a link is replaced: `continuity.py`.
- Mirrors follow the `FarGraph`. A single task makes and closes them. So fast changes on the far side build up
  no queue.
- Messages and nodes never go back to the bus that they came from. Mirrors are only mirrored again for topics
  with `transit`.
- Subscriptions are announced before publishers. So the first message finds its subscriptions.

Read first: `bridge.py`, `continuity.py`, then `export.py` and `imports.py`.

Tests: `tests/unit/bus_bridge/core/`; `tests/system/test_bridge_core.py`,
`tests/system/test_bridge_faults.py`, `tests/system/test_bridge_loops.py`,
`tests/system/test_bridge_three.py`, `tests/system/test_bridge_renames.py`,
`tests/system/test_bridge_reload.py`.
"""

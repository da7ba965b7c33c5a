"""Bridges: topics and services of this bus on other machines, and on ROS 2.

    this bus <-> `core/` (mirrors, routes, rules, counters) <-> `engine.py` (interface) <-> `zenoh/`, `dds/`
                                                                             or `rmw_zenoh/`

A bridge is a client of the bus and runs in a separate process. `program.py` runs a bridge. `options.py` and
`config.py` have its settings, `labels.py` the rule for names in them, and `extras.py` the packages that an
engine needs. `reloading.py` applies new rules at SIGHUP. Messages travel in batches: `batch.py`, `packed.py`.
`checks.py` checks announced nodes and endpoints.

Invariants:

- The core knows no engine; an engine knows neither busd nor nodes. Both sides know only `engine.py`.
- All data from a far bus is hostile until it is checked. Limits apply to each far bus separately.
- Each message of a route is sent, waits, or is dropped for a counted reason.
- No call of an engine blocks the event loop. An engine's threads pass their news to it through bounded
  queues.
- Small messages of one publisher stay together in one buffer from end to end.
- Only an engine imports its package (`zenoh`, `cyclonedds`). import-linter checks this for zenoh.
- `ros2/` has the parts of ROS 2 that `dds/` and `rmw_zenoh/` share.

Read first: `engine.py`, then `core/bridge.py`; docs/bridge.md for users' view.

Tests: `tests/unit/bus_bridge/`, on `tests/world/engine_pair.py`; `tests/system/test_bridge_core.py`,
`tests/system/test_bridge_faults.py`, `tests/system/test_bridge_zenoh.py`, `tests/system/test_bridge_ros2.py`.
"""

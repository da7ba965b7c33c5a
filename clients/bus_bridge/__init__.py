"""Bridges: topics and services of this bus on other machines, and on ROS 2.

    this bus <-> `core/` (mirrors, ways, rules, counters) <-> `engine.py` (interface) <-> `zenoh/` or `dds/`

A bridge is a client like any other, in a process of its own. `program.py` runs one, `options.py` and
`config.py` have its settings, `extras.py` the packages that an engine needs. Messages travel in batches:
`batch.py`, `packed.py`.

Invariants:

- The core knows no engine; an engine knows neither busd nor nodes. Both sides know only `engine.py`.
- Everything that a far bus says is hostile until it is checked. It is bounded for each far bus.
- Each message of a route is sent, waits, or is dropped for a counted reason.
- No call of an engine blocks the event loop. An engine's threads hand their news over, bounded.
- Small messages of one publisher stay together in one buffer from end to end.
- Packages of engines (`zenoh`, `cyclonedds`) are imported only by their engine. import-linter checks zenoh's.

Read first: `engine.py`, then `core/bridge.py`; docs/bridge.md for users' view.

Tests: `tests/unit/bus_bridge/`, on `tests/world/engine_pair.py`; `tests/system/test_bridge_core.py`,
`tests/system/test_bridge_faults.py`, `tests/system/test_bridge_zenoh.py`, `tests/system/test_bridge_ros2.py`.
"""

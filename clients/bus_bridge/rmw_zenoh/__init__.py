"""The engine for ROS 2 on zenoh: nodes of this bus as programs with rmw_zenoh see theirs, and the reverse.

    `engine.py` --+-- `graph.py`  tokens of other programs (`keys.py`, `qos_text.py`) --> the bridge
                  +-- `writing.py`, `reading.py`  topics: the routes out and in (`attachment.py`)
                  +-- `services.py`  calls <-> `bus_bridge.ros2`
    zenoh: `session.py`, which adds to `bus_bridge.zenoh.session`;  `options.py`

Invariants:

- ROS 2's nodes see our nodes as nodes of ROS 2: keys, tokens, attachments and gids follow rmw_zenoh.
- Tokens are hostile. A session that exceeds a limit is refused alone.
- Tokens of busds have a special enclave. Bridges ignore them, so two bridges do not repeat messages.
- A subscription, or a queryable, exists in zenoh before its token: a program that sees the token may use it.
- Only `session.py` uses the package zenoh, and only `keys.py` the package xxhash.

Read first: `keys.py`, `graph.py`, `engine.py`.

Tests: `tests/unit/bus_bridge/rmw_zenoh/`, `tests/property/test_rmw_zenoh_hostile.py`,
`tests/system/test_bridge_rmw_zenoh.py`, `tests/system/test_bridge_pyzeros.py`.
"""

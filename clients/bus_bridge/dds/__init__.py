"""The engine for DDS, as ROS 2 speaks it, on cyclonedds; with the extra `ros2`.

    `engine.py` --+-- `discovery.py`  far endpoints --> `graph.py` (whose they are) --> the bridge
                  +-- `node_info.py`, `node_topic.py`   `ros_discovery_info`: nodes, ours and theirs
                  +-- `writing.py`    ways out
                  +-- `reading.py`    ways in: which reader carries which writer (`early.py`: before that)
    cyclonedds: `participant.py`, `raw.py`;  translations: `names.py`, `qos.py`, `idl.py`, `known_types.py`

Invariants:

- ROS 2's nodes see ours as nodes of ROS 2: names, QoS, types and hashes follow rmw's rules.
- Payloads stay CDR here; `bus_ros.cdr` translates them.
- Nothing blocks: if DDS has no room, the rest of a batch waits with the caller.
- One reader carries the messages of a far writer. If another takes over, no message is repeated or missing.
- Endpoints of other busds are ignored; a mark in USER_DATA tells them.
- Private parts of cyclonedds are used in `raw.py` only; a test fails if one of them changes.

Read first: `engine.py`, `names.py`, then `reading.py`.

Tests: `tests/unit/bus_bridge/dds/`, `tests/system/test_bridge_dds_engine.py`,
`tests/system/test_bridge_dds_ros.py`, `tests/system/test_bridge_ros2.py`.
"""

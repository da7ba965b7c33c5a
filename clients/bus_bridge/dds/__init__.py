"""The engine for DDS, as ROS 2 uses it: topics by cyclonedds or our RTPS, services by our RTPS.

    `engine.py` --+-- `discovery.py`  far endpoints --> `graph.py` (their nodes) --> the bridge
                  +-- `carrier.py`, the interface to the carrier of topics, one of two:
       `cyclone.py`      cyclonedds: `participant.py`, `raw.py`, `idl.py`;  routes: `writing.py`, `reading.py`
                         nodes: `node_info.py`, `node_topic.py`
       `rtps_topics.py`  our RTPS
    translations: `names.py`, `qos.py`; types, payloads and routes out: `bus_bridge.ros2`

    services: `bus_bridge.ros2` <-> `services.py` (`service_identity.py`) <-> `bus_bridge.rtps`
    how far it looks: `environment.py` (ROS 2's variables), `options.py`, `interfaces.py`
    far servers and clients: `discovery.py` (`client_pairs.py`), as other endpoints

Invariants:

- ROS 2's nodes see our nodes as nodes of ROS 2: names, QoS, types and hashes follow rmw's rules.
- Payloads stay CDR here; `bus_ros.cdr` translates them.
- Nothing blocks: if DDS has no room, the rest of a batch waits with the caller.
- One reader carries the messages of a far writer. If another takes over, no message is repeated or missing.
- Endpoints of other busds are ignored. They have a mark in USER_DATA.
- Only `raw.py` uses private parts of cyclonedds; a test fails if one of them changes.

Read first: `engine.py`, `names.py`, then `rtps_topics.py`, the simpler carrier.

Tests: `tests/unit/bus_bridge/dds/`, `tests/system/test_bridge_dds_engine.py`,
`tests/system/test_bridge_dds_ros.py`, `tests/system/test_bridge_ros2.py`; of services
`tests/system/test_rtps_services_ros.py`, `tests/system/test_bridge_ros2_services.py`,
`tests/system/test_bridge_ros2_lifecycle.py`, `tests/system/test_bridge_ros2_deaths.py`; how far it looks
`tests/system/test_bridge_discovery_range.py`.
"""

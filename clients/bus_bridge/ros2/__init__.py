"""Parts of ROS 2 that are the same for each middleware: types, payloads, and the calls of services.

    types: `known_types.py`, `service_types.py`, `type_names.py`;  payloads: `samples.py`
    topics: `route_out.py`;  `early.py`: messages before their route
    services: the bridge's routes <-> `service_ways.py` <-> `service_calls.py` (`open_requests.py`) <->
        `calls.py`, the interface to the carrier of calls;  `turns.py`: the order of many calls
    also: `service_hash.py`, `domain.py`

Invariants:

- Payloads are CDR, and on the bus MessagePack; `bus_ros.cdr` translates them.
- Each call ends once: with an answer, with an error (only on this bus), or because its client has gone.
- Nothing here knows a middleware: no keys, no GUIDs of DDS, no sockets.

Read first: `calls.py`, `service_ways.py`.

Tests: `tests/unit/bus_bridge/ros2/`, and the tests of `bus_bridge.dds`.
"""

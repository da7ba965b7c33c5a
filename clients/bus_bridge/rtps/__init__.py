"""RTPS, the protocol below DDS, in plain Python: the parts for ROS 2's services that no package offers.

    datagrams <-> `messages.py` (`parameters.py`, `ids.py`);  discovery: `announcements.py`, `policies.py`
    samples <-> `writer.py` <-> `messages.py` <-> `reader.py` (`fragments.py`, `room.py`; states: `lives.py`)

    datagrams <-> `participant.py` (`local.py`, `far.py`, `own_announcements.py`, `outbox.py`) <-> its user
                  `client.py`: the same for clients of Discovery Servers (`serials.py`: has a peer restarted?)
    event loop: `running.py` (`sockets.py`; the addresses to call: `reach.py`)

All except `running.py` and `sockets.py` is pure: bytes, values and times in, bytes and values out.

Invariants:

- Nothing in a datagram is believed: lengths are checked against its bytes, and sets and lists have limits.
- Every fault of a far participant is an RtpsError, and never another exception. It is counted, or a warning.
- Participants, their endpoints, and the length of a lease have limits.
- One datagram causes few others: repairs and answers to requests have pauses.
- A reader delivers each sample of a reliable writer once and in order, or counts it.
- Memory for samples that can't be delivered yet has a limit for each far participant.
- Nothing here knows ROS 2's names, or the bus.

Read first: `messages.py`, then `lives.py` and `writer.py`, then `participant.py`.

Tests: `tests/unit/bus_bridge/rtps/`, `tests/property/test_rtps_wire.py`,
`tests/property/test_rtps_reliability.py`; the fuzzers of `tests/fuzz/rtps_targets.py` and
`tests/fuzz/discovery_targets.py`; with ROS 2's own rclpy `tests/system/test_rtps_ros.py`,
`tests/system/test_bridge_discovery_server.py`, between
machines `tests/system/test_rtps_network.py`.
"""

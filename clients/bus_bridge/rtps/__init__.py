"""RTPS, the protocol below DDS, in plain Python: what ROS 2's services need and no package offers.

    datagrams <-> `messages.py` (`parameters.py`, `ids.py`);  discovery: `announcements.py`

All of it is pure: bytes and values in, bytes and values out.

Invariants:

- Nothing in a datagram is believed: lengths are checked against its bytes, and sets and lists have limits.
- Every fault of a far participant is an RtpsError, and never another exception.
- Nothing here knows ROS 2's names, or the bus.

Read first: `messages.py`, then `announcements.py`.

Tests: `tests/unit/bus_bridge/rtps/`, `tests/property/test_rtps_wire.py`, and the fuzzers `datagrams` and
`announcements` of `tests/fuzz/rtps_targets.py`.
"""

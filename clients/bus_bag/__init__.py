"""Bags: recordings of topics, in files that every tool of ROS 2 opens.

    bus  --> `record/` --> `storage/` --> files --> `storage/` --> `play/` --> bus
                                                          +-----> `info.py`, `convert.py`, `reindex.py`

`metadata.py` has metadata.yaml, `profiles.py` QoS profiles in YAML, `losses.py` what a recording lacks,
`life.py` the base of the tables of states, `terminal/` keys and the line of progress. The verbs of the
command line are in `clients/bus_cli/bag/`.

Invariants:

- rosbag2 opens bags that are written here, and bags of rosbag2 are read here. Its rules and texts apply.
- The accounts close: each message that publishers sent to a recorder was written, waits, or was lost for a
  counted reason.
- Any bytes may stand in a file. Reading ends, raises only BagError and OSError, and takes bounded memory.
- A bag that was cut off anywhere (power, `kill -9`) is readable up to its last whole chunk.
- Bags depend on `bus`, `bus_ros.cdr` and below, not on launches or transforms. import-linter checks this.

Read first: `storage/bag_file.py`, then `record/recorder.py` or `play/player.py`; docs/bag.md for users' view.

Tests: `tests/unit/bus_bag/`, `tests/property/test_bag_damage.py`, `tests/system/test_bag_record.py`,
`tests/system/test_bag_play.py`, `tests/system/test_cli_bag.py`.
"""

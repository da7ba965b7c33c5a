"""Bags: recordings of topics, in files that every tool of ROS 2 opens.

    bus  --> `record/` --> `storage/` --> files --> `storage/` --> `play/` --> bus
                                                          +-----> `info.py`, `convert.py`, `reindex.py`

`metadata.py` has metadata.yaml, `profiles.py` QoS profiles in YAML, and `losses.py` counts missing messages.
`page.py` plays a bag on the page of `bus web`. `life.py` is the base of the tables of states. `terminal/` has
keys and the line of progress. The verbs of the command line are in `clients/bus_cli/bag/`.

Invariants:

- rosbag2 opens bags written here, and this package reads bags of rosbag2. rosbag2's rules and texts apply.
- The counters add up: each message that publishers sent to a recorder was written, waits, or was lost for a
  counted reason.
- A file may contain any bytes. Reading ends, raises only BagError and OSError, and uses limited memory.
- A bag that was cut off anywhere (power, `kill -9`) is readable up to its last complete chunk.
- Bags depend on `bus`, `bus_ros.cdr` and below, and for the page on `bus_web.playback`; not on launches or
  transforms. import-linter checks this.

Read first: `storage/bag_file.py`, then `record/recorder.py` or `play/player.py`; docs/bag.md for users' view.

Tests: `tests/unit/bus_bag/`, `tests/property/test_bag_damage.py`, `tests/system/test_bag_record.py`,
`tests/system/test_bag_play.py`, `tests/system/test_cli_bag.py`.
"""

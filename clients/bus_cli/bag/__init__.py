"""`bus bag`: recordings of topics in files, and their replay.

The verbs read the command line; `bus_bag` does the work. `playargs.py` has the options of play and burst.
`reading.py` is shared by the verbs that read a bag.

Invariants: options have the same names and rules as in `ros2 bag`; `bus bag record --help` loads no storage
package.

Read first: `record.py`. Tests: `tests/unit/bus_cli/bag/`, `tests/system/test_cli_bag.py`.
"""

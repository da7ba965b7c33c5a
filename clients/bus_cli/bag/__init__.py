"""`bus bag`: what is on the bus, into files and back.

The verbs read the command line; `bus_bag` does the work. `playargs.py` has the options of play and burst,
`reading.py` what verbs that read a bag share.

Invariants: options and their rules are those of `ros2 bag`; `bus bag record --help` loads no storage package.

Read first: `record.py`. Tests: `tests/unit/bus_cli/bag/`, `tests/system/test_cli_bag.py`.
"""

"""`bus bridge`: the bus of this machine joined with those of others, and with ROS 2.

`zenoh.py` and `ros2.py` run a bridge with options (`bridgeargs.py`) that are added to busd.toml; `status.py`
asks running bridges by their service (`remote.py`).

Invariants: the work is done in `bus_bridge`; a missing extra gives one line with the command that installs
it.

Read first: `bridgeargs.py`. Tests: `tests/unit/bus_cli/bridge/`, `tests/system/test_bridge_cli.py`.
"""

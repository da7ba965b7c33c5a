"""`bus bridge`: connects the bus of this machine to buses of other machines, and to ROS 2.

`zenoh.py` and `ros2.py` run a bridge. They add options (`bridgeargs.py`) to those in busd.toml. `status.py`
asks running bridges through their service (`remote.py`).

Invariants: `bus_bridge` does the work; if an extra is missing, one line shows the command that installs it.

Read first: `bridgeargs.py`. Tests: `tests/unit/bus_cli/bridge/`, `tests/system/test_bridge_cli.py`.
"""

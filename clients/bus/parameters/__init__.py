"""Parameters of a node, and the clock that `use_sim_time` chooses.

    Node --> `host.py` (methods) --> `served.py` --+-- `parameter_set.py`  Python's values -> `store.py`
                                                   +-- `server.py`         six services, /parameter_events
                                                   +-- `time_source.py`    /clock
    rclpy's nodes (`bus_ros.rclpy`) ------------------------------------------------------> `store.py`

`store.py` has the declared parameters and their changes; `values.py` the types and rules; `file.py` YAML
files and `-p name:=value`; `messages.py` the conversion from and to rcl_interfaces; `owner.py` the methods
that parameters need of a node.

Invariants:

- Rules, texts of errors and the order of callbacks are ROS 2's. Both APIs, `bus.Node` and rclpy, share
  `store.py` and `values.py`, and so can't differ.
- `store.py` and `values.py` know no message, node, file or event loop.
- A wrong request of another program gets an answer with the reason. It never raises an error in this program.
- A node without parameters does not pay for them: `served.py` starts the services when they are needed.

Read first: `store.py`, then `served.py`.

Tests: `tests/unit/bus/parameters/`, `tests/system/test_parameters.py`; rclpy's view:
`tests/unit/bus_ros/rclpy/test_node_parameters.py`.
"""

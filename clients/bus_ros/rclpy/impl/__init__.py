"""Internal modules of rclpy that programs import nevertheless: the logger's class, severities, errors.

The folder also has parts of the facade without a counterpart in rclpy: a node's native node
(`native_node.py`), its view of the graph (`node_graph.py`), its parameters (`node_parameters.py`), the
threads of an executor (`worker_threads.py`), wait sets for programs that wait themselves (`wait_set.py`,
`events.py`).

Invariants:

- A name of rclpy.impl is here under the same name. Everything else may change freely.
- `node_parameters.py` has only rclpy's calls; rules and changes are in `bus.parameters.store`.

Read first: `node_graph.py` and `node_parameters.py`. Tests: `tests/unit/bus_ros/rclpy/`,
`tests/system/test_rclpy_node.py`, `tests/system/test_rclpy_own_executors.py`.
"""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name == "implementation_singleton":  # programs use it after only `import rclpy`
        return import_module("bus_ros.rclpy.impl.implementation_singleton")
    raise AttributeError(f"module 'rclpy.impl' has no attribute {name!r}")

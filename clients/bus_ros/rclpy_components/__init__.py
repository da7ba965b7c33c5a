"""Components in Python: node classes that a running container loads and unloads by service.

    `component_container.py`   the programs, found by `bus run`
    `component_manager.py`     the node with the services of ROS 2's container
    `registry.py`              component types of installed packages; classes by name

Invariants:

- The services and their texts are ROS 2's, so genuine tools can work with the container.
- A component that fails affects neither the container nor other components.

docs/cli.md, "Components", describes them for users.

Read first: `component_manager.py`. Tests: `tests/unit/bus_ros/rclpy_components/`,
`tests/system/test_cli_component.py`.
"""

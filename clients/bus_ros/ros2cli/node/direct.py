"""`ros2cli.node.direct`: a node for a tool, with the context that it needs."""

import os
from argparse import ArgumentParser
from time import monotonic
from typing import Any, Self

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.type_description_service import START_TYPE_DESCRIPTION_SERVICE_PARAM
from bus_ros.ros2cli.node import NODE_NAME_PREFIX

__all__ = ["DEFAULT_TIMEOUT", "DirectNode", "add_arguments"]

DEFAULT_TIMEOUT = 0.5
"""Seconds during which a new node spins."""

NamesAndTypes = list[tuple[str, list[str]]]


class DirectNode(Node):
    """A node that initializes the default context, and ends it with itself: `with DirectNode(args) as node:`.

    `args` is the result of an argument parser, or None. Its attributes that count, all optional:
    `argv`, `node_name_suffix`, `spin_time`, `start_parameter_services`, `start_type_description_service`,
    `use_sim_time`.

    Raises RuntimeError if the default context is initialized already.
    """

    def __init__(self, args: Any, *, node_name: str | None = None) -> None:
        rclpy.init(args=getattr(args, "argv", []))
        self._make(args, node_name)
        end_s = monotonic() + float(getattr(args, "spin_time", DEFAULT_TIMEOUT))
        while (left_s := end_s - monotonic()) > 0:
            rclpy.spin_once(self, timeout_sec=left_s)

    def _make(self, args: Any, node_name: str | None) -> None:
        suffix = getattr(args, "node_name_suffix", f"_{os.getpid()}")
        has_types = getattr(args, "start_type_description_service", True)
        super().__init__(
            NODE_NAME_PREFIX + suffix if node_name is None else node_name,
            start_parameter_services=getattr(args, "start_parameter_services", False),
            parameter_overrides=[
                Parameter("use_sim_time", value=getattr(args, "use_sim_time", False)),
                Parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, value=has_types),
            ],
            automatically_declare_parameters_from_overrides=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy_node()
        rclpy.try_shutdown()

    @property
    def node(self) -> Node:
        """The node itself."""
        return self


def add_arguments(parser: ArgumentParser) -> None:
    """Add the options that a DirectNode follows to a parser of arguments."""
    parser.add_argument(
        "--spin-time",
        type=float,
        default=DEFAULT_TIMEOUT,
        help="seconds that the tool's node spins at its start",
    )
    parser.add_argument("-s", "--use-sim-time", action="store_true", help="use the time of /clock")

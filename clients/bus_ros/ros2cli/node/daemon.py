"""`ros2cli.node.daemon`: the daemon of ROS 2's tools, which on busd is busd itself.

ROS 2's daemon keeps a view of the graph for tools. busd has the graph, but it also connects all programs. So
`shutdown_daemon` does not end it; the command `bus daemon stop` does.
"""

from argparse import ArgumentParser
from typing import Any

from bus.link.query import NotRunning, Query
from bus.process.address import socket_path
from bus_ros.ros2cli.node.strategy import NodeStrategy

__all__ = ["DaemonNode", "add_arguments", "is_daemon_running", "shutdown_daemon", "spawn_daemon"]


class DaemonNode(NodeStrategy):
    """A node for questions about the graph, as a NodeStrategy. It starts a busd if none runs."""

    @property
    def connected(self) -> bool:
        """Whether it can answer questions."""
        return bool(self.context.ok())


def is_daemon_running(args: Any) -> bool:
    """Whether a busd runs. `args` has no effect here and below."""
    try:
        with Query(socket_path(None, None), may_start=False):
            return True
    except NotRunning:
        return False


def spawn_daemon(args: Any, timeout: float | None = None, debug: bool = False) -> bool:
    """Start a busd in the background; returns False if one runs already. It ends when it has been idle.

    Returns when it is ready; `timeout` and `debug` have no effect. Raises BrokerUnavailable with the reason
    if it can't be started.
    """
    if is_daemon_running(args):
        return False
    with Query(socket_path(None, None)):
        return True


def shutdown_daemon(args: Any, timeout: float | None = None) -> bool:
    """Returns False: nothing was shut down, because the running programs need busd."""
    return False


def add_arguments(parser: ArgumentParser) -> None:
    """Add the options of a DaemonNode to a parser of arguments: none."""

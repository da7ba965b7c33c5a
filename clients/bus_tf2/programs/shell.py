"""Common parts of the programs of tf2: their arguments, and a normal end on Ctrl-C and SIGTERM."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.exceptions import NotInitializedException
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.utilities import remove_ros_args

__all__ = ["begun", "own_words"]


def own_words() -> list[str]:
    """The program's arguments without ROS's, and without its name."""
    return remove_ros_args(args=sys.argv)[1:]


@contextmanager
def begun() -> Iterator[None]:
    """rclpy, from its beginning to its end; an interrupt ends the block, also just before it sleeps."""
    with rclpy.init(), suppress(KeyboardInterrupt, ExternalShutdownException, NotInitializedException):
        yield

"""`ros2cli.helpers`: waiting, standard input and arguments of tools."""

import os
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable
from math import inf
from time import monotonic, sleep
from typing import TypeVar

__all__ = ["collect_stdin", "get_ros_domain_id", "unsigned_int", "wait_for"]

T = TypeVar("T")


def get_ros_domain_id() -> int:
    """The number in ROS_DOMAIN_ID, by default 0; busd itself does not use it."""
    return int(os.environ.get("ROS_DOMAIN_ID", 0))


def wait_for(predicate: Callable[[], T], timeout: float, period: float = 0.1) -> T | bool:
    """Call `predicate` each `period` seconds until its result is true; then returns True.

    After `timeout` seconds (negative: never) returns the result of a last call.
    """
    end_s = inf if timeout < 0 else monotonic() + timeout
    while not predicate():
        if monotonic() > end_s:
            return predicate()
        sleep(period)
    return True


def unsigned_int(string: str) -> int:
    """The type of an argument that is a whole number from 0; raises ArgumentTypeError."""
    value = _whole(string)
    if value < 0:
        raise ArgumentTypeError("value must be non-negative integer")
    return value


def collect_stdin() -> bytes:
    """All bytes of the standard input up to its end."""
    return sys.stdin.buffer.read()


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        return -1

"""Common parts of the tests of AsyncNode: a context on the test's daemon, and a node.

Import the fixtures `context` and `node` as well. At the end, `context` fails if an AsyncNode made an engine.
"""

from collections.abc import AsyncIterator, Iterator
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros import engine as engines
from bus_ros.rclpy.experimental import AsyncNode
from bus_ros.rclpy.signals import SignalHandlerOptions
from bus_ros.rosidl import message_class
from conftest import Daemon

__all__ = ["String", "context", "node"]

String: Any = message_class("std_msgs/msg/String")


@pytest.fixture
def context(daemon: Daemon) -> Iterator[None]:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()
    assert engines.current() is None, "an AsyncNode needs no engine"


@pytest.fixture
async def node(context: None) -> AsyncIterator[AsyncNode]:
    async with AsyncNode("tester") as node:
        yield node

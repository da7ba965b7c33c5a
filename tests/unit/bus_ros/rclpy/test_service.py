"""A service of the facade, without a bus: the moment at which an executor learns of a request."""

from collections import deque
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

from bus.service.server import RequestId
from bus.srv.example_interfaces import AddTwoInts
from bus_ros.rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from bus_ros.rclpy.qos import qos_profile_services_default
from bus_ros.rclpy.service import Service


class Robot:
    """A node with an executor."""

    def __init__(self, executor: object) -> None:
        self.own_executor = executor


def test_a_request_that_is_quicker_than_the_call_that_creates_waits_for_it() -> None:
    """Otherwise an executor in another thread could take the request, and could not answer it."""
    executor = SimpleNamespace(ready=deque(), waiter=SimpleNamespace(is_set=True))
    node: Any = Robot(executor)
    native: Any = SimpleNamespace(service_name="/add")
    engine: Any = SimpleNamespace(loop=nullcontext())
    group = MutuallyExclusiveCallbackGroup()
    service = Service(engine, AddTwoInts, "add", max, group, qos_profile_services_default, node)
    service.on_request(AddTwoInts.Request(a=1), RequestId(bytes(16), 1))
    assert not executor.ready
    service.begin(native)
    service.notify()  # as the node does with each new entity
    assert list(executor.ready) == [service] and service.service_name == "/add"
    service.on_request(AddTwoInts.Request(a=2), RequestId(bytes(16), 2))
    assert list(executor.ready) == [service]

"""The turtle of the lesson is asked for until it is there."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

from bus_ros.rclpy.task import Future
from bus_tf2.turtle_tf2_py.spawner import Spawner


def test_a_call_that_fails_is_repeated() -> None:
    answers: list[Future[Any]] = [Future(), Future()]
    client = Mock(call_async=Mock(side_effect=answers), service_is_ready=Mock(return_value=True))
    log: list[str] = []
    node: Any = Mock(create_client=Mock(return_value=client))
    node.get_logger.return_value = Mock(info=log.append)
    spawner = Spawner(node, "turtle2")
    assert not spawner.is_there()
    answers[0].set_exception(RuntimeError("its server has left"))
    assert not spawner.is_there() and not spawner.is_there()
    answers[1].set_result(SimpleNamespace(name="turtle2"))
    assert spawner.is_there()
    assert log == ["Spawn failed: its server has left", "Successfully spawned turtle2"]

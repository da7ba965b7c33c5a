"""rclpy.parameter_event_handler without a bus: the callbacks for an event, and their order."""

from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rclpy.parameter_event_handler import ParameterEventHandler


@pytest.fixture
def handler() -> ParameterEventHandler:
    node: Any = SimpleNamespace(
        create_subscription=lambda *arguments, **options: None,
        get_namespace=lambda: "/robot",
        get_fully_qualified_name=lambda: "/robot/watcher",
    )
    return ParameterEventHandler(node)


def event(node: str, **values: int) -> Any:
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return parameter_message("ParameterEvent")(node=node, changed_parameters=parameters)


def test_the_newest_callback_is_called_first_and_events_come_last(handler: ParameterEventHandler) -> None:
    said: list[str] = []
    handler.add_parameter_event_callback(lambda event: said.append("event"))
    first = handler.add_parameter_callback("speed", "camera", lambda one: said.append("first"))
    handler.add_parameter_callback("speed", "/robot/camera", lambda one: said.append("second"))
    handler.add_parameter_callback("size", "camera", lambda one: said.append("size"))
    handler._callbacks.event_callback(event("/robot/camera", speed=1))
    assert said == ["second", "first", "event"]
    handler.remove_parameter_callback(first)
    with pytest.raises(RuntimeError, match="Callback doesn't exist"):
        handler.remove_parameter_callback(first)
    said.clear()
    handler._callbacks.event_callback(event("/robot/camera", speed=1, size=2))
    assert said == ["second", "size", "event"]


def test_a_removed_callback_leaves_nothing_behind(handler: ParameterEventHandler) -> None:
    handle = handler.add_parameter_callback("speed", "", print)
    assert handler._callbacks.parameter_callbacks == {("speed", "/robot/watcher"): [handle]}
    handler.remove_parameter_callback(handle)
    assert handler._callbacks.parameter_callbacks == {}
    every = handler.add_parameter_event_callback(print)
    handler.remove_parameter_event_callback(every)
    with pytest.raises(RuntimeError, match="Callback doesn't exist"):
        handler.remove_parameter_event_callback(every)


def test_names_of_nodes(handler: ParameterEventHandler) -> None:
    assert [handler._resolve_path(name) for name in ("", "camera", "/camera")] == [
        *("/robot/watcher", "/robot/camera", "/camera"),
    ]

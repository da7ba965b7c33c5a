"""Lifecycle nodes on asyncio's event loop, by both routes and on both event loops."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.experimental import AsyncLifecycleNode, AsyncNode
from bus_ros.rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from bus_ros.rosidl import message_class, service_class
from rclpy_async_world import String, context, node
from semantics import until

__all__ = ["context", "node"]

pytestmark = pytest.mark.usefixtures("route", "context")

ChangeState: Any = service_class("lifecycle_msgs/srv/ChangeState")
GetState: Any = service_class("lifecycle_msgs/srv/GetState")
TransitionEvent: Any = message_class("lifecycle_msgs/msg/TransitionEvent")
SUCCESS = TransitionCallbackReturn.SUCCESS


class Camera(AsyncLifecycleNode):
    """Its configuration waits, and its cleanup fails."""

    def __init__(self) -> None:
        super().__init__("camera")
        self.calls: list[str] = []
        self.frames = self.create_lifecycle_publisher(String, "frames", 10)

    async def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # type: ignore[override]
        self.calls.append(f"configure from {state.label}")
        await asyncio.sleep(0.001)
        self.calls.append("configured")
        return SUCCESS

    async def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # type: ignore[override]
        await asyncio.sleep(0)
        raise ValueError("no")

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.calls.append("error")
        return SUCCESS


@pytest.fixture
async def camera(context: None) -> AsyncIterator[Camera]:
    async with Camera() as camera:
        yield camera


def label(camera: Camera) -> str:
    return camera._state_machine.current_state[1]


async def test_by_the_program_itself(camera: Camera) -> None:
    trigger: Any = camera
    assert await trigger.trigger_configure() is SUCCESS
    assert camera.calls == ["configure from unconfigured", "configured"] and label(camera) == "inactive"
    assert await trigger.trigger_activate() is SUCCESS
    assert label(camera) == "active"
    with pytest.raises(RCLError):
        await trigger.trigger_configure()


async def test_a_callback_that_raises(camera: Camera) -> None:
    trigger: Any = camera
    await trigger.trigger_configure()
    assert await trigger.trigger_cleanup() is TransitionCallbackReturn.ERROR
    assert camera.calls[-1] == "error" and label(camera) == "unconfigured"


async def test_by_another_program(camera: Camera, node: AsyncNode) -> None:
    events: list[str] = []
    node.create_subscription(
        TransitionEvent,
        "/camera/transition_event",
        lambda event: events.append(event.goal_state.label),
        10,
    )
    change = node.create_client(ChangeState, "/camera/change_state")
    get = node.create_client(GetState, "/camera/get_state")
    await change.wait_for_service()
    await get.wait_for_service()
    request = ChangeState.Request()
    request.transition.label = "configure"
    assert (await change.call(request)).success
    assert not (await change.call(request)).success
    assert (await get.call(GetState.Request())).current_state.label == "inactive"
    await until(lambda: events == ["configuring", "inactive"])


async def test_its_publisher_publishes_only_while_it_is_active(camera: Camera, node: AsyncNode) -> None:
    trigger: Any = camera
    got: list[str] = []
    node.create_subscription(String, "frames", lambda message: got.append(message.data), 10)
    await until(lambda: camera.frames.get_subscription_count() == 1)
    camera.frames.publish(String(data="too early"))
    await trigger.trigger_configure()
    await trigger.trigger_activate()
    camera.frames.publish(String(data="in time"))
    await until(lambda: got)
    await trigger.trigger_deactivate()
    camera.frames.publish(String(data="too late"))
    assert camera.destroy_lifecycle_publisher(camera.frames)
    assert got == ["in time"]

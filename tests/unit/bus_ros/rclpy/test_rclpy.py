"""Callback groups, utilities, signals, and names of actions."""

import signal
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bus_ros.rclpy import action, duration, signals, utilities
from bus_ros.rclpy.action import client as action_client
from bus_ros.rclpy.action import server as action_server
from bus_ros.rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from bus_ros.rclpy.context import Context
from bus_ros.rosidl import message_class


class Entity:
    pass


def test_one_callback_at_a_time() -> None:
    group = MutuallyExclusiveCallbackGroup()
    first, second = cast(Any, Entity()), cast(Any, Entity())
    group.add_entity(first)
    assert group.has_entity(first) and not group.has_entity(second)
    assert group.can_execute(first) and group.beginning_execution(first)
    assert not group.can_execute(second) and not group.beginning_execution(second)
    with pytest.raises(AssertionError):
        group.ending_execution(second)
    group.ending_execution(first)
    assert group.beginning_execution(second)


def test_reentrant_callbacks() -> None:
    group, entity = ReentrantCallbackGroup(), Entity()
    for _ in range(2):
        assert group.can_execute(entity) and group.beginning_execution(entity)
    group.ending_execution(entity)


def test_a_group_keeps_nothing_alive() -> None:
    group, entity = ReentrantCallbackGroup(), cast(Any, Entity())
    group.add_entity(entity)
    assert len(group.entities) == 1
    del entity
    assert len(group.entities) == 0


def test_the_base_decides_nothing() -> None:
    calls: list[Callable[[object], object]] = [
        CallbackGroup().can_execute,
        CallbackGroup().beginning_execution,
        CallbackGroup().ending_execution,
    ]
    for call in calls:
        with pytest.raises(NotImplementedError):
            call(Entity())


def test_only_one_of_many_threads_begins() -> None:
    group = MutuallyExclusiveCallbackGroup()
    begun: list[bool] = []
    threads = [
        threading.Thread(target=lambda: begun.append(group.beginning_execution(Entity()))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert sorted(begun) == [False] * 7 + [True]


def test_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    argv = ["talker", "-n", "3", "--ros-args", "-r", "a:=b", "--", "last"]
    assert utilities.remove_ros_args(argv) == ["talker", "-n", "3", "last"]
    monkeypatch.setattr(sys, "argv", argv)
    assert utilities.remove_ros_args() == ["talker", "-n", "3", "last"]
    with pytest.raises(ValueError, match="remap rule"):
        utilities.remove_ros_args(["--ros-args", "-r"])


def test_timeouts() -> None:
    assert utilities.timeout_sec_to_nsec(None) == utilities.timeout_sec_to_nsec(-0.1) == -1
    assert utilities.timeout_sec_to_nsec(1.5) == 1_500_000_000
    assert duration.S_TO_NS == 1_000_000_000
    assert utilities.get_rmw_implementation_identifier() == "rmw_busd"


def test_calls_go_to_the_context(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def context(name: str) -> Any:
        return SimpleNamespace(
            ok=lambda: bool(calls.append(f"{name} ok")) or True,
            shutdown=lambda: calls.append(f"{name} shutdown"),
            try_shutdown=lambda: calls.append(f"{name} try_shutdown"),
        )

    module: Any = (
        sys.modules.get("bus_ros.rclpy.context") or __import__("bus_ros.rclpy.context").rclpy.context
    )
    monkeypatch.setattr(module, "get_default_context", lambda *, shutting_down=False: context("default"))
    other = context("other")
    assert utilities.ok() and utilities.ok(context=other)
    utilities.shutdown()
    utilities.shutdown(context=other)
    utilities.try_shutdown()
    utilities.try_shutdown(context=other)
    assert calls == [
        f"{name} {call}" for call in ("ok", "shutdown", "try_shutdown") for name in ("default", "other")
    ]


def test_a_signal_ends_all_contexts() -> None:
    contexts = Context(), Context()
    for context in contexts:
        context.init([])
    signals.install_signal_handlers(signals.SignalHandlerOptions.SIGTERM)
    try:
        signal.raise_signal(signal.SIGTERM)
    finally:
        signals.uninstall_signal_handlers()
    for context in contexts:
        assert not context.ok()
        context.shutdown()  # allowed once after the signal


def test_names_of_actions() -> None:
    assert action.GoalResponse.ACCEPT is action_server.default_goal_callback(None)
    assert action.CancelResponse.REJECT is action_server.default_cancel_callback(None)
    assert action_client.GoalStatus is message_class("action_msgs/msg/GoalStatus")
    with pytest.raises(AttributeError):
        action_client.nonsense  # noqa: B018

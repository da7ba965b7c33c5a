"""Tasks by name, and the updater's timer, without a node."""

from typing import Any
from unittest.mock import Mock

from bus_ros.diagnostic_updater import DiagnosticTaskVector, Updater


def test_a_removed_task_is_gone() -> None:
    tasks = DiagnosticTaskVector()
    for name in ("a", "b", "a"):
        tasks.add(name, lambda status: status)
    assert tasks.removeByName("a")
    assert [task.name for task in tasks.tasks] == ["b", "a"]
    assert not tasks.removeByName("c")


def test_a_new_period_replaces_the_timer() -> None:
    node: Any = Mock()
    node.has_parameter.return_value = False
    node.declare_parameter.side_effect = lambda name, default: Mock(value=default)
    node.create_timer.side_effect = lambda period, call: Mock(period=period)
    updater = Updater(node, period=2.0)
    first: Any = updater.timer
    assert first.period == updater.period == 2.0
    updater.period = 0.5
    node.destroy_timer.assert_called_once_with(first)
    second: Any = updater.timer
    assert second.period == updater.period == 0.5

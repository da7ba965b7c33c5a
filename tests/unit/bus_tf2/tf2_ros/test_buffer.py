"""Buffer: look-ups that wait, without a node."""

from typing import Any

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time
from bus_tf2.tf2_ros import Buffer, LookupException
from rows import for_each
from tf2_world import at, transform


@for_each("method", ["set_transform", "set_transform_static"])
def test_a_new_transform_ends_the_wait_for_it(method: str) -> None:
    buffer = Buffer()
    found: Any = buffer.wait_for_transform_async("a", "b", Time())
    full: Any = buffer.wait_for_transform_full_async("a", Time(), "b", Time(), "a")
    getattr(buffer, method)(transform("a", "c"), "me")
    assert not found.done() and not full.done()
    getattr(buffer, method)(transform("a", "b", moved=(1, 0, 0)), "me")
    assert found.result().transform.translation.x == full.result().transform.translation.x == 1.0
    assert buffer._new_data_callbacks == []


def test_a_look_up_whose_time_is_over_is_not_called_any_more() -> None:
    buffer = Buffer()
    assert not buffer.can_transform("a", "b", Time(), Duration(nanoseconds=1))
    with pytest.raises(LookupException):
        buffer.lookup_transform("a", "b", Time(), Duration(nanoseconds=1))
    assert buffer._new_data_callbacks == []


def test_a_canceled_wait_is_not_called_any_more() -> None:
    buffer = Buffer()
    buffer.wait_for_transform_async("a", "b", Time()).cancel()
    assert buffer._new_data_callbacks == []


def test_a_jump_back_clears_all_but_static_transforms() -> None:
    buffer = Buffer()
    buffer.set_transform(transform("a", "b", 1), "me")
    buffer.set_transform_static(transform("a", "c"), "me")
    jump: Any = None
    buffer.time_jump_callback(jump)
    assert not buffer.can_transform("a", "b", at(1))
    assert buffer.can_transform("a", "c", at(1))

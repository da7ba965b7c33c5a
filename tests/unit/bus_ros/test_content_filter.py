"""bus_ros/content_filter.py: messages that pass, and errors in an expression."""

from typing import Any

import pytest

from bus_ros.content_filter import FilterError, compile_filter
from bus_ros.rosidl import message_class
from rows import for_each

Odometry: Any = message_class("nav_msgs/msg/Odometry")


def odometry() -> Any:
    made = Odometry(child_frame_id="base_link")
    made.header.frame_id = "odom"
    made.header.stamp.sec = 7
    made.twist.twist.linear.x = 1.5
    return made


def passes(expression: str, *parameters: str) -> bool:
    return compile_filter(expression, parameters, Odometry())(odometry())


@for_each(
    "expression",
    (
        "header.stamp.sec = 7",
        "header.stamp.sec <> 8 AND header.stamp.sec != 9",
        "twist.twist.linear.x > 1 and twist.twist.linear.x <= 1.5e0",
        "header.frame_id = 'odom'",
        "'odom' = header.frame_id",
        "child_frame_id LIKE 'base%' AND child_frame_id LIKE '?ase_link'",
        "header.stamp.sec BETWEEN 7 AND 9",
        "header.stamp.sec NOT BETWEEN 8 AND 9",
        "NOT header.stamp.sec = 8",
        "header.stamp.sec = 8 OR header.stamp.sec = 7 AND header.frame_id = 'odom'",
        "(header.stamp.sec = 7 OR header.stamp.sec = 8) AND NOT (header.frame_id = 'map')",
        "header.stamp.sec > -1",
    ),
)
def test_what_passes(expression: str) -> None:
    assert passes(expression)
    assert not passes(f"NOT ({expression})")


def test_parameters() -> None:
    assert passes("header.stamp.sec = %0 AND header.frame_id = %1", "7", "'odom'")
    assert passes("header.frame_id = %0", "odom")
    assert not passes("header.stamp.sec = %0", "8")


def test_what_can_not_be_compared_does_not_pass() -> None:
    assert not passes("header.frame_id > 3")
    assert not passes("NOT (header.frame_id > 3)")
    assert not passes("header LIKE 'x'")


@for_each(
    ("expression", "text"),
    (
        ("", "a field or a value is missing at column 1"),
        ("header.stamp.sec", "a comparison is missing at column 17"),
        ("header.stamp.sec = ", "a field or a value is missing at column 20"),
        ("header.stamp.sek = 1", "the message has no field 'header.stamp.sek'; did you mean 'sec'?"),
        ("child_frame_id.x = 1", "the message has no field 'child_frame_id.x'"),
        ("(header.stamp.sec = 1", r"'\)' is missing at column 22"),
        ("header.stamp.sec = 1 header", "AND, OR or the end is missing at column 22"),
        ("header.stamp.sec = %1", "there is no parameter %1: there are 0"),
        ("header.stamp.sec ~ 1", "what begins at column 17 can't be read"),
        ("header.stamp.sec BETWEEN 1 OR 2", "AND is missing at column 28"),
        ("(" * 60 + "header.stamp.sec = 1" + ")" * 60, "nested deeper than 50"),
    ),
)
def test_what_is_wrong(expression: str, text: str) -> None:
    with pytest.raises(FilterError, match=text):
        compile_filter(expression, (), Odometry())

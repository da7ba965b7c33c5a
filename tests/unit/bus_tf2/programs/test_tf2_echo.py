"""The output of tf2_echo, and its command line."""

import math

import pytest

from bus_tf2.programs.tf2_echo import Wish, lines, read
from rows import for_each
from tf2_world import transform, yaw


def test_a_transform() -> None:
    found = transform("world", "robot", 1.05, (1, -2, 0.5), yaw(math.pi / 2))
    assert lines(found) == [
        "At time 1.050000000",
        "- Translation: [1.000, -2.000, 0.500]",
        "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.707, 0.707]",
        "- Rotation: in RPY (radian) [0.000, -0.000, 1.571]",
        "- Rotation: in RPY (degree) [0.000, -0.000, 90.000]",
        "- Matrix:",
        "  0.000 -1.000  0.000  1.000",
        "  1.000  0.000  0.000 -2.000",
        "  0.000  0.000  1.000  0.500",
        "  0.000  0.000  0.000  1.000",
    ]
    assert lines(transform("world", "robot"), 1)[:2] == ["At time 0.0", "- Translation: [0.0, 0.0, 0.0]"]


def test_straight_up() -> None:
    """If the pitch is a right angle, roll and yaw turn about the same axis."""
    half = math.sqrt(0.5)
    assert lines(transform("a", "b", turned=(0, half, 0, half)))[4].endswith("[0.000, 90.000, 0.000]")
    assert lines(transform("a", "b", turned=(0, -half, 0, half)))[4].endswith("[0.000, -90.000, 0.000]")


def test_command_lines() -> None:
    assert read(["a", "b"]) == Wish("a", "b")
    assert read(["a", "b", "2.5"]) == Wish("a", "b", 2.5)
    assert read(["a", "b", "-r", "10", "-t", "1.5", "-p", "6"]) == Wish("a", "b", 10.0, 1.5, 6)
    for precision in (0, 20):
        assert read(["a", "b", "-p", str(precision)]) == Wish("a", "b", precision=precision)
    for line in ("", "a", "a b 1 c", "a b -x", "a b -r"):
        assert read(line.split()) is None


@for_each(
    ("line", "text"),
    [
        ("a b fast", "Failed to convert rate argument 'fast' to a floating-point number"),
        ("a b -t now", "Failed to convert time argument 'now' to a floating-point number"),
        ("a b -t nan", "Time must be from 0 to 9223372036 seconds, and is 'nan'"),
        ("a b -t inf", "Time must be from 0 to 9223372036 seconds, and is 'inf'"),
        ("a b -t -1", "Time must be from 0 to 9223372036 seconds, and is '-1'"),
        ("a b -t 1e10", "Time must be from 0 to 9223372036 seconds, and is '1e10'"),
        ("a b -p some", "Failed to convert precision argument 'some' to an integer"),
        ("a b 0", "Rate must be positive"),
        ("a b -r nan", "Rate must be positive"),
        ("a b -p 99", "Precision must be from 0 to 20, and is '99'"),
    ],
)
def test_values_that_are_none(line: str, text: str) -> None:
    with pytest.raises(ValueError, match=f"^{text}$"):
        read(line.split())

"""The command line of static_transform_publisher, with the texts of ROS 2."""

import math

import pytest

from bus_tf2.programs.static_transform_publisher import Wish, read
from rows import for_each


def wish(line: str) -> Wish | None:
    return read(line.split())


NAMES = "--frame-id a --child-frame-id b"


@for_each(
    ("line", "moved", "turned"),
    [
        (NAMES, (0, 0, 0), (0, 0, 0, 1)),
        (f"--x 1 --y -2 --z 3.5 {NAMES}", (1, -2, 3.5), (0, 0, 0, 1)),
        (f"--qx 0.5 --qy 0.5 --qz 0.5 --qw 0.5 {NAMES}", (0, 0, 0), (0.5, 0.5, 0.5, 0.5)),
        (f"--yaw {math.pi / 2} {NAMES}", (0, 0, 0), (0, 0, math.sqrt(0.5), math.sqrt(0.5))),
        (f"--roll {math.pi} {NAMES} --pitch 0", (0, 0, 0), (1, 0, 0, 0)),
        (f"1 2 3 {math.pi} 0 0 a b", (1, 2, 3), (0, 0, 1, 0)),
        ("1 2 3 0.5 0.5 0.5 0.5 a b", (1, 2, 3), (0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_what_is_asked_for(line: str, moved: tuple[float, ...], turned: tuple[float, ...]) -> None:
    found = wish(line)
    assert found is not None
    assert (found.frame_id, found.child_frame_id) == ("a", "b")
    assert found.translation == pytest.approx(moved)
    assert found.rotation == pytest.approx(turned)
    assert found.is_old_style is (NAMES not in line)


def test_help() -> None:
    assert wish("--help") is None
    assert wish("--x 1 -h") is None


@for_each(
    ("line", "text"),
    [
        ("", "Not enough arguments to parse"),
        ("--x", "Not enough arguments for --x"),
        ("--yaw left", "Failed to parse --yaw argument as float"),
        ("1 2 here 0 0 0 a b", "Failed to parse z argument as float"),
        (f"--yaw 1 --qw 1 {NAMES}", "Cannot specify both quaternion and Euler rotations"),
        ("1 2 3 0 0 0 a b --x 1", "Cannot specify both new-style (flags) and old-style (arguments)"),
        (f"more {NAMES}", "Extra unparsed arguments on command-line"),
        ("--x 1 --child-frame-id b", "Frame id must not be empty"),
        ("--frame-id a", "Child frame id must not be empty"),
    ],
)
def test_what_is_wrong(line: str, text: str) -> None:
    with pytest.raises(ValueError, match=f"^{text.replace('(', '.').replace(')', '.')}$"):
        wish(line)

"""Robots read from URDF, and the places of their links by their joints."""

import math
from itertools import pairwise

import pytest

from bus_tf2.robot.urdf import Joint, Mimic, UrdfError, parse
from rows import for_each
from tf2_world import yaw


def robot(inside: str) -> str:
    return f'<robot name="r">{inside}</robot>'


LINKS = '<link name="a"/><link name="b"/>'
ENDS = '<parent link="a"/><child link="b"/>'


def joint(kind: str, inside: str = "", ends: str = ENDS, name: str = "j") -> str:
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def only(kind: str, inside: str = "") -> Joint:
    [found] = parse(robot(LINKS + joint(kind, inside))).joints
    return found


def test_a_robot() -> None:
    found = parse(
        '<?xml version="1.0" encoding="utf-8"?>' + robot(LINKS + "<material name='m'/>" + joint("fixed"))
    )
    assert (found.name, found.root, found.links) == ("r", "a", ["a", "b"])
    assert [one.name for one in found.joints] == ["j"]
    assert parse(robot('<link name="a"/>')).root == "a"


def test_a_long_robot_takes_no_minutes() -> None:
    names = [f"l{number}" for number in range(20_000)]
    links = "".join(f'<link name="{name}"/>' for name in names)
    joints = "".join(
        joint("fixed", ends=f'<parent link="{parent}"/><child link="{child}"/>', name=child)
        for parent, child in pairwise(names)
    )
    assert parse(robot(links + joints)).root == "l0"


def test_poses() -> None:
    origin = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    moved, turned = only("fixed", origin).pose(5.0)
    assert moved == (1, 2, 3)
    assert turned == pytest.approx(yaw(math.pi / 2))
    moved, turned = only("revolute", origin + '<axis xyz="0 0 -2"/>').pose(math.pi / 2)
    assert moved == (1, 2, 3)
    assert turned == pytest.approx(yaw(0))
    moved, turned = only("prismatic", origin + '<axis xyz="2 0 0"/>').pose(0.5)
    assert moved == pytest.approx((1, 2.5, 3))
    assert turned == pytest.approx(yaw(math.pi / 2))
    assert only("continuous").pose(math.pi)[1] == pytest.approx((1, 0, 0, 0))


@for_each("position", [math.inf, -math.inf, math.nan])
def test_a_position_that_is_no_number(position: float) -> None:
    """It must not end the program: a tf2 buffer refuses the transform."""
    for kind in ("prismatic", "revolute", "continuous"):
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
        assert math.isnan(sum(map(sum, only(kind, limit).pose(position))))
    assert only("fixed").pose(position) == ((0, 0, 0), (0, 0, 0, 1))


def test_limits_and_mimic() -> None:
    assert only("continuous").limits == (-math.pi, math.pi)
    assert only("revolute").limits is None
    found = only("revolute", '<limit lower="-1" upper="2"/><safety_controller soft_upper_limit="1.5"/>')
    assert (found.limits, found.soft_limits) == ((-1, 2), (-math.inf, 1.5))
    assert only("revolute", '<mimic joint="k" multiplier="2"/>').mimic == Mimic("k", 2.0, 0.0)


@for_each(
    ("text", "fault"),
    [
        ("", "it is no XML: no element found"),
        ("<robot>", "it is no XML: "),
        ("<model/>", "Could not find the 'robot' element in the xml file"),
        (robot(""), "No link elements found in urdf file"),
        (robot("<link/>"), "a link has no name"),
        (robot('<link name="a"/><link name="a"/>'), "link 'a' is not unique."),
        (robot(LINKS), "Two root links found: [a] and [b]"),
        (robot(LINKS + joint("hinge")), "joint 'j' has no known type: 'hinge'"),
        (robot(LINKS + joint("fixed", ends='<child link="b"/>')), "joint 'j' has no parent link"),
        (robot(LINKS + joint("fixed", ends='<parent link="a"/>')), "joint 'j' has no child link"),
        (robot('<link name="a"/>' + joint("fixed")), "joint 'j': there is no link 'b'"),
        (robot(LINKS + joint("fixed") + joint("fixed")), "joint 'j' is not unique."),
        (
            robot(LINKS + joint("fixed") + joint("fixed", name="k")),
            "link 'b' is the child of two joints: 'j' and 'k'",
        ),
        (
            robot(
                LINKS + joint("fixed") + joint("fixed", ends='<parent link="b"/><child link="a"/>', name="k")
            ),
            "No root link found. The robot xml is not a valid tree.",
        ),
        (
            robot(
                '<link name="c"/>'
                + LINKS
                + joint("fixed")
                + joint("fixed", ends='<parent link="b"/><child link="a"/>', name="k")
            ),
            "No root link found. The robot xml is not a valid tree.",
        ),
        (robot(LINKS + joint("revolute", '<axis xyz="0 0 0"/>')), "joint 'j': its axis is of length zero"),
        (robot(LINKS + joint("fixed", '<origin xyz="1 2"/>')), "joint 'j': xyz='1 2' is not three numbers"),
        (
            robot(LINKS + joint("fixed", '<origin rpy="0 nan 0"/>')),
            "joint 'j': rpy='0 nan 0' is not three numbers",
        ),
        (robot(LINKS + joint("revolute", '<limit upper="far"/>')), "joint 'j': upper='far' is no number"),
        (robot(LINKS + joint("revolute", "<mimic/>")), "joint 'j': mimic names no joint"),
    ],
)
def test_what_is_no_robot(text: str, fault: str) -> None:
    with pytest.raises(UrdfError) as caught:
        parse(text)
    assert str(caught.value).startswith(fault)

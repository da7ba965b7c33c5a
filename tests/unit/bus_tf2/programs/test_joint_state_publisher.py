"""joint_state_publisher: positions, limits and joints that follow others, without a bus."""

from typing import Any

import pytest

from bus_tf2.programs import joint_state_publisher as module
from bus_tf2.programs.joint_state_publisher import JointStatePublisher
from bus_tf2.robot.urdf import Mimic, parse

ROBOT = """<robot name="arm"><link name="base"/><link name="hand"/><link name="finger"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="hand"/>
<limit lower="0" upper="1"/><safety_controller soft_lower_limit="0.1" soft_upper_limit="0.5"/></joint>
<joint name="claw" type="revolute"><parent link="hand"/><child link="finger"/>
<limit lower="-1" upper="1"/></joint>
</robot>"""


class Joints(JointStatePublisher):
    """Has the robot's joints, and no node."""

    def __init__(self, dependent: dict[str, Mimic] | None = None, **settings: Any) -> None:
        self._settings = module._DEFAULTS | settings
        self._zeros: dict[str, Any] = {}
        self._dependent = dependent or {}
        self._directions: dict[str, int] = {}
        self._set_up(parse(ROBOT))

    def moved(self, delta: float) -> float:
        self._move(delta)
        return self._states["slide"]["position"]


def test_a_joint_moves_to_and_fro_between_its_limits() -> None:
    joints = Joints()  # it begins at 0.3
    positions = [joints.moved(0.25) for _ in range(6)]
    assert positions == pytest.approx([0.5, 0.25, 0.1, 0.35, 0.5, 0.25])


def test_the_smallest_limits_are_used_if_that_is_set() -> None:
    assert Joints()._limits["slide"] == (0.1, 0.5)
    assert Joints(use_smallest_joint_limits=False)._limits["slide"] == (0.0, 1.0)


def test_a_joint_follows_another_with_a_factor_and_an_offset() -> None:
    joints = Joints({"claw": Mimic("slide", 2.0, 0.1)})
    joints._states["slide"] = {"position": 0.3, "velocity": 1.0}
    assert joints._state_of("claw") == {"position": pytest.approx(0.7), "velocity": 2.0}


def test_joints_that_follow_each_other_have_no_state() -> None:
    joints = Joints({"claw": Mimic("slide", 1.0, 0.0), "slide": Mimic("claw", 1.0, 0.0)})
    assert joints._state_of("claw") == joints._state_of("slide") == {}


@pytest.mark.parametrize("value", ["fast", True, [1.0], None])
def test_what_is_no_number_is_named(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^rate is .*; it must be a number$"):
        module._number("rate", value)

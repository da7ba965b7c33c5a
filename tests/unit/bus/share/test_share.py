"""The shipped definitions are ROS 2's: hashes of all types, their defaults and constants, and imports.

`type_hashes.txt` has the first 16 digits of each hash (for an action: of goal, result and feedback). ROS 2's
own tools computed them from the sources of ROS 2's packages; `tests/typehashes.py` does that again.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import bus
import typehashes
from benchmarks import ros
from bus.types.classes import message_class
from bus.types.definitions import find_message
from bus.types.support import type_hash
from bus_ros.rosidl import action_class, service_class
from bus_ros.rosidl import message_class as ros_message_class
from bus_ros.rosidl.description import service_hash
from differential import genuine
from rows import for_each

SHARE = Path(str(bus.__file__)).parent / "share"
SHIPPED = sorted(
    f"{path.parents[1].name}/{path.parent.name}/{path.stem}"
    for kind in ("msg", "srv", "action")
    for path in SHARE.glob(f"*/{kind}/*")
)
HASHES = dict(line.split() for line in (Path(__file__).parent / "type_hashes.txt").read_text().splitlines())
WITHOUT_HASH = {"nav2_msgs/srv/GetCosts", "nav_msgs/msg/Goals"}
"""Types of versions of ROS 2 that are later than the files compared."""


@pytest.fixture(autouse=True)
def only_shipped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No other definitions are found before the shipped ones."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("BUS_INTERFACE_PATH", raising=False)
    monkeypatch.chdir(tmp_path)


@for_each(("name", "digits"), HASHES.items())
def test_hashes_are_those_of_ros(name: str, digits: str) -> None:
    ours = service_hash(name) if "/srv/" in name else type_hash(message_class(name))
    assert ours.startswith(f"RIHS01_{digits}")


@pytest.mark.nightly
@pytest.mark.timeout(1200)
def test_the_tools_of_ros_compute_these_hashes() -> None:
    if reason := genuine.missing():
        pytest.skip(reason)
    packages = sorted({str(SHARE / name.partition("/")[0]) for name in SHIPPED})
    command = [str(ros.PYTHON), typehashes.__file__, *packages]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    computed = dict(line.split() for line in done.stdout.splitlines())
    assert {name: computed[name] for name in HASHES} == HASHES
    assert set(computed) - set(HASHES) == WITHOUT_HASH


def test_every_definition_has_its_hash() -> None:
    listed = {name.rpartition("_")[0] if "/action/" in name else name for name in HASHES}
    assert set(SHIPPED) - listed == WITHOUT_HASH


@for_each("name", SHIPPED)
def test_definitions_begin_with_a_description(name: str) -> None:
    package, kind, short = name.split("/")
    assert (SHARE / package / kind / f"{short}.{kind}").read_text().startswith("# ")


@for_each(
    ("name", "field", "value"),
    [
        ("control_msgs/msg/MotionPrimitive", "type", -1),
        ("irobot_create_msgs/action/DriveArc_Goal", "max_translation_speed", pytest.approx(0.3)),
        ("nav2_msgs/action/DockRobot_Goal", "max_staging_time", 1000.0),
        ("nav2_msgs/action/UndockRobot_Result", "success", True),
        ("ros_gz_interfaces/msg/EntityFactory", "relative_to", "world"),
        ("ros_gz_interfaces/msg/WorldControl", "multi_step", 0),
        ("turtlebot3_msgs/msg/Sound", "value", 0),
    ],
)
def test_defaults(name: str, field: str, value: Any) -> None:
    assert getattr(ros_message_class(name)(), field) == value


@for_each(
    ("name", "constant", "value"),
    [
        ("control_msgs/msg/VDA5050SafetyState", "AUTO_ACK", "autoAck"),
        ("gazebo_msgs/srv/GetJointProperties_Response", "UNIVERSAL", 5),
        ("gps_msgs/msg/GPSStatus", "STATUS_NO_FIX", -1),
        ("irobot_create_msgs/msg/IrOpcode", "CODE_IR_EVAC_BOTH_FIELD", 252),
        ("moveit_msgs/msg/MoveItErrorCodes", "NO_IK_SOLUTION", -31),
        ("moveit_msgs/srv/ServoCommandType_Request", "POSE", 2),
        ("nav2_msgs/action/Spin_Result", "COLLISION_AHEAD", 703),
        ("py_trees_ros_interfaces/msg/ActivityItem", "NO_KEY", "NO_KEY"),
        ("ros_gz_interfaces/msg/SensorNoise", "GAUSSIAN_QUANTIZED", 3),
        ("turtlebot3_msgs/msg/SensorState", "ERROR_RIGHT_MOTOR", 2),
    ],
)
def test_constants(name: str, constant: str, value: Any) -> None:
    assert getattr(ros_message_class(name), constant) == value
    assert constant in {one.name for one in find_message(name).constants}


@for_each("name", SHIPPED)
def test_every_class_can_be_made(name: str) -> None:
    kind = name.split("/")[1]
    make: Any = {"msg": ros_message_class, "srv": service_class, "action": action_class}[kind]
    cls = make(name)
    parts = {
        "msg": [cls],
        "srv": [getattr(cls, "Request", None), getattr(cls, "Response", None)],
        "action": [getattr(cls, part, None) for part in ("Goal", "Result", "Feedback")],
    }[kind]
    for part in parts:
        assert part() == part()
        assert list(part.get_fields_and_field_types()) == [name.lstrip("_") for name in part.__slots__]


def test_programs_import_them(tmp_path: Path) -> None:
    """As programs do: one import of each package's module."""
    modules = sorted({name.rpartition("/")[0].replace("/", ".") for name in SHIPPED})
    program = tmp_path / "program.py"
    lines = [f"import {module} as it\nprint(len([getattr(it, n) for n in it.__all__]))" for module in modules]
    program.write_text("\n".join(["import bus.rclpy_compat", *lines]))
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, check=True)
    assert sum(map(int, done.stdout.split())) == len(SHIPPED)

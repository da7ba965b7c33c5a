"""The programs of tf2 as users start them: `bus run tf2_ros static_transform_publisher`, and so on."""

import asyncio
import signal
from pathlib import Path

import pytest

from bus_ros import packages
from cli import bus, wait_for_graph
from packaged import run_bus
from programs import on_one_loop, running

RUN = ("-m", "bus_cli", "run")
STAMP = r"\[\d{10}\.\d{9}\]"

pytestmark = pytest.mark.usefixtures("daemon")


@on_one_loop
async def test_a_static_transform(tmp_path: Path) -> None:
    words = ["--x", "1", "--frame-id", "world", "--child-frame-id", "robot"]
    async with running(tmp_path, *RUN, "tf2_ros", "static_transform_publisher", *words) as publisher:
        await publisher.line("^from 'world' to 'robot'$")
        heard = bus(
            "topic", "echo", "--once", "/tf_static", "--field", "transforms[0].transform.translation.x"
        )
        assert heard.out.startswith("1.0\n")
        publisher.process.send_signal(signal.SIGINT)
        assert await publisher.end() == 0
    first, *rest = publisher.lines
    assert first.endswith(": Spinning until stopped - publishing transform")
    assert rest == [
        "translation: ('1.000000', '0.000000', '0.000000')",
        "rotation: ('0.000000', '0.000000', '0.000000', '1.000000')",
        "from 'world' to 'robot'",
    ]


@on_one_loop
async def test_a_transform_is_echoed_and_drawn(tmp_path: Path) -> None:
    words = ["--x", "1", "--frame-id", "world", "--child-frame-id", "robot"]
    async with (
        running(tmp_path, *RUN, "tf2_ros", "static_transform_publisher", *words) as publisher,
        running(tmp_path, *RUN, "tf2_ros", "tf2_echo", "world", "robot", "20") as echo,
        running(tmp_path, *RUN, "tf2_ros", "tf2_monitor", "world", "robot") as monitor,
    ):
        await echo.line(r"^- Translation: \[1.000, 0.000, 0.000\]$")
        echo.process.send_signal(signal.SIGINT)
        assert await echo.end() == 0
        await monitor.line("^Gathering data on world -> robot for 10 seconds...$")
        monitor.process.send_signal(signal.SIGTERM)
        assert await monitor.end() == 0
        name = str(tmp_path / "frames")
        said = run_bus("run", "tf2_tools", "view_frames", "-t", "0.5", "-o", name, PATH="")
        assert said.code == 0
        assert "there is no 'dot' (Debian: apt install graphviz)" in said.err
        publisher.process.send_signal(signal.SIGINT)
        assert await publisher.end() == 0
    drawing = await asyncio.to_thread(Path(f"{name}.gv").read_text)
    assert '"world" -> "robot"' in drawing
    assert [line for line in echo.lines if "Waiting" not in line][1:3] == [
        "- Translation: [1.000, 0.000, 0.000]",
        "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.000, 1.000]",
    ]


async def listening(count: int) -> None:
    """Returns once /tf has this many subscriptions, so the program waits for transforms."""
    await asyncio.to_thread(wait_for_graph, lambda graph: len(graph.subscriptions_of("/tf")) == count)


@on_one_loop
async def test_sigterm_while_the_monitor_waits_for_transforms(tmp_path: Path) -> None:
    async with running(tmp_path, *RUN, "tf2_ros", "tf2_monitor", "world", "robot") as monitor:
        await listening(2)
        monitor.process.send_signal(signal.SIGTERM)
        assert await monitor.end() == 0
    (line,) = monitor.lines
    assert line.startswith("Waiting for transform chain to become available between world and robot ")


LAUNCH = """
from launch import LaunchDescription
from launch_ros.actions import Node

ARM = '''<?xml version="1.0"?><robot name="arm"><link name="base"/><link name="hand"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="hand"/>
<limit lower="0.25" upper="0.75"/></joint></robot>'''


def generate_launch_description():
    names = ("robot_state_publisher", "joint_state_publisher")
    given = [{"robot_description": ARM, "frame_prefix": "one/"}]
    states, joints = (Node(package=name, executable=name, parameters=given) for name in names)
    words = ["map", "one/hand", "20"]
    echo = Node(package="tf2_ros", executable="tf2_echo", arguments=words, output="screen")
    words = [*"0 0 1 0 0 0".split(), "map", "one/base"]
    place = Node(package="tf2_ros", executable="static_transform_publisher", arguments=words)
    return LaunchDescription([states, joints, place, echo])
"""


@on_one_loop
async def test_in_a_launch_file(tmp_path: Path) -> None:
    """Most robots start them so."""
    file = tmp_path / "arm.launch.py"
    file.write_text(LAUNCH)
    async with running(tmp_path, "-m", "bus_cli", "launch", file, ROS_LOG_DIR=str(tmp_path)) as launch:
        await launch.line(r"^\[tf2_echo-4\] - Translation: \[0.500, 0.000, 1.000\]$")
        launch.process.send_signal(signal.SIGINT)
        await launch.end()
    assert sum("process has finished cleanly" in line for line in launch.lines) == 4


def test_what_is_wrong_is_said() -> None:
    said = run_bus("run", "tf2_ros", "static_transform_publisher", "--x", "far")
    assert said.code == 1
    assert ": error parsing command line arguments: Failed to parse --x argument as float\n" in said.err
    assert said.out.startswith("usage: static_transform_publisher [--x X] ")
    said = run_bus(
        "run", "tf2_ros", *["static_transform_publisher", "--frame-id", "a", "--child-frame-id", "a"]
    )
    assert said.code == 1
    assert ": cannot publish static transform from 'a' to 'a', exiting\n" in said.err
    said = run_bus("run", "tf2_ros", "tf2_echo", "a", "b", "fast")
    assert (said.code, said.err.splitlines()[0]) == (
        2,
        "Failed to convert rate argument 'fast' to a floating-point number",
    )
    assert run_bus("run", "tf2_ros", "tf2_echo").out.startswith("Usage: tf2_echo source_frame target_frame")
    assert run_bus("run", "tf2_ros", "tf2_monitor", "a").code == 1


def test_as_verbs_of_bus() -> None:
    """The verbs pass on which bus is meant."""
    said = bus("tf2", "echo", "a", "b", "--rate", "0")
    assert (said.code, said.err) == (2, "Rate must be positive\n")
    assert bus("tf2", "monitor", "a").code == 1
    said = run_bus("tf2", "frames", "-t", "0.1", "-o", "/nowhere/frames")
    assert said.code == 1
    assert "can't write '/nowhere/frames.gv': No such file or directory\n" in said.err


@on_one_loop
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_verbs_of_bus_end_by_the_signal(number: signal.Signals, tmp_path: Path) -> None:
    """So a loop in the shell ends, too."""
    verb = (tmp_path, "-m", "bus_cli", "tf2")
    async with (
        running(*verb, "echo", "world", "robot") as echo,
        running(*verb, "monitor", "world", "robot") as monitor,
        running(*verb, "frames", "--wait-time", "1000", "--output", str(tmp_path / "frames")) as frames,
    ):
        await listening(4)
        for program in (echo, monitor, frames):
            program.process.send_signal(number)
            assert await program.end() == -number
            assert not any("Traceback" in line for line in program.lines)


def test_they_are_found_like_those_of_packages() -> None:
    found = packages.executables("tf2_ros")
    assert found is not None
    assert "static_transform_publisher" in [one.name for one in found]
    assert "tf2_ros static_transform_publisher\n" in bus("pkg", "executables", "tf2_ros").out
    assert bus("run", "tf2_ros", "static_transform").err == (
        "No executable found\ndid you mean 'static_transform_publisher'?\n"
    )
    assert bus("run", "tf2_ro", "x").err == "Package 'tf2_ro' not found\ndid you mean 'tf2_ros'?\n"

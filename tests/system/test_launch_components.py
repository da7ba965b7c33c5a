"""Launch files with containers: components in Python, what can't be loaded, missing containers, the end."""

import signal
from pathlib import Path

import pytest

from launching import write
from programs import on_one_loop, running

PARTS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self, **kwargs):
        super().__init__("talker", **kwargs)
        text = self.declare_parameter("text", "hi").value
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.timer = self.create_timer(0.02, lambda: self.publisher.publish(String(data=text)))

class Listener(Node):
    def __init__(self, **kwargs):
        super().__init__("listener", **kwargs)
        self.create_subscription(String, "chatter", self.hear, 10)

    def hear(self, message):
        print(f"{self.get_fully_qualified_name()} heard {message.data}", flush=True)
        rclpy.shutdown()

class Fatal(Node):
    def __init__(self, **kwargs):
        import os
        os._exit(3)
"""
PYTHON = """
import os
from launch import LaunchDescription
from launch.conditions import IfCondition
from launch_ros.actions import ComposableNodeContainer, LoadComposableNodes, PushRosNamespace
from launch_ros.descriptions import ComposableNode

def generate_launch_description():
    container = ComposableNodeContainer(
        name="box", namespace="", package="rclcpp_components", executable="component_container",
        cwd=os.path.dirname(__file__), output="screen",
        composable_node_descriptions=[
            ComposableNode(package="image_proc", plugin="image_proc::RectifyNode", name="rectify"),
            ComposableNode(
                package="parts", plugin="parts:Talker", name="speaker", namespace="a",
                parameters=[{"text": "yo"}], remappings=[("chatter", "/words")],
                extra_arguments=[{"use_intra_process_comms": True}],
            ),
            ComposableNode(package="x", plugin="y", condition=IfCondition("false")),
        ],
    )
    return LaunchDescription([
        container,
        PushRosNamespace("b"),
        LoadComposableNodes(target_container="box", composable_node_descriptions=[
            ComposableNode(package="parts", plugin="parts:Listener", remappings=[("chatter", "/words")]),
        ]),
    ])
"""
XML = """<launch>
  <node_container pkg="rclpy_components" exec="component_container_isolated" name="box" namespace="ns"
                  cwd="$(dirname)" output="screen">
    <composable_node pkg="parts" plugin="parts:Talker" name="speaker" namespace="a">
      <param name="text" value="from xml"/>
      <remap from="chatter" to="/words"/>
      <extra_arg name="use_intra_process_comms" value="true"/>
    </composable_node>
    <composable_node pkg="parts" plugin="parts:Fatal" name="fatal" if="false"/>
  </node_container>
  <load_composable_node target="/ns/box">
    <composable_node pkg="parts" plugin="parts:Listener" name="ear">
      <remap from="chatter" to="/words"/>
    </composable_node>
  </load_composable_node>
</launch>
"""
FATAL = """<launch>
  <node_container pkg="rclpy_components" exec="component_container" name="box" namespace="" cwd="$(dirname)">
    <composable_node pkg="parts" plugin="parts:Fatal" name="fatal"/>
    <composable_node pkg="parts" plugin="parts:Talker" name="next"/>
  </node_container>
</launch>
"""
NOBODY = """<launch>
  <load_composable_node target="nobody">
    <composable_node pkg="parts" plugin="parts:Talker" name="talker"/>
  </load_composable_node>
</launch>
"""
LOG = "[launch_ros.actions.load_composable_nodes]: "


@pytest.fixture
def folder(tmp_path: Path, daemon: object) -> Path:
    files = {"parts.py": PARTS, "a.launch.py": PYTHON, "a.xml": XML, "fatal.xml": FATAL, "nobody.xml": NOBODY}
    return write(tmp_path / "here", files)


def logged(lines: list[str]) -> list[str]:
    return [line for line in lines if LOG in line]


@on_one_loop
async def test_components_of_a_launch_file(folder: Path) -> None:
    async with running(folder, "-m", "bus_cli", "launch", folder / "a.launch.py") as launch:
        assert await launch.end() == 0
        assert launch.family() == []
    errors = [line for line in logged(launch.lines) if "[ERROR]" in line]
    assert errors == [
        f"[ERROR] {LOG}Failed to load node 'rectify' of type 'image_proc::RectifyNode' in container '/box': "
        "Package 'image_proc' has no component 'image_proc::RectifyNode' in Python; components in C++ can't "
        "be loaded here"
    ]
    assert f"[INFO] {LOG}Loaded node '/a/speaker' in container '/box'" in launch.lines
    assert any(line.endswith("/b/listener heard yo") for line in launch.lines)


@on_one_loop
async def test_components_in_xml(folder: Path) -> None:
    async with running(folder, "-m", "bus_cli", "launch", folder / "a.xml") as launch:
        assert await launch.end() == 0
    assert f"[INFO] {LOG}Loaded node '/a/speaker' in container '/ns/box'" in launch.lines
    assert any(line.endswith("/ear heard from xml") for line in launch.lines)


@on_one_loop
async def test_a_container_that_ends(folder: Path) -> None:
    """The launch ends, too: it does not wait for an answer."""
    async with running(folder, "-m", "bus_cli", "launch", folder / "fatal.xml") as launch:
        assert await launch.end() == 0
    failed = [line.partition(LOG)[2] for line in logged(launch.lines)]
    assert [line.partition(" of type ")[0] for line in failed] == [
        "Failed to load node 'fatal'",
        "Failed to load node 'next'",
    ]
    assert failed[1].endswith("in container '/box': the container has ended")


@on_one_loop
async def test_a_missing_container(folder: Path) -> None:
    async with running(folder, "-m", "bus_cli", "launch", folder / "nobody.xml") as launch:
        await launch.line("Waiting for container '/nobody': no node has the service ")
        launch.process.send_signal(signal.SIGINT)
        assert await launch.end() == 0
    assert logged(launch.lines)[-1] == (
        f"[WARNING] {LOG}Abandoning wait for the '/nobody/_container/load_node' service, due to shutdown."
    )

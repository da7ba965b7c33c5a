"""The time of `bus launch` until each node, written for rclpy in a separate process, has been heard.

It is measured from the start of `bus launch` until a message of each node has arrived in another process,
which was running before.
"""

import select
import signal
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic_ns

import msgspec

from benchmarks.adapters.hearing import Heard
from benchmarks.cases import Case, Figures, interleave
from benchmarks.harness import START_S, STOP_S, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import BUS

NAME = "launching"
_FEW, _MANY = 1, 10
_LIMIT_S = 60.0
_TOPIC = "launched"
_GOAL_S = 2.0
_COLUMNS = [
    Column("heard_s", "s: all heard", "lower"),
    Column("end_s", "Ctrl-C until all have ended", "lower"),
    Column("cpu_s", "CPU s: bus launch itself", "lower"),
]
_NOTES = [
    "nodes with rclpy, which publish at once and then ten times a second, started by a launch file in Python",
]
_TALKER = """
import sys
import rclpy
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import String

def main():
    rclpy.init()
    node = rclpy.create_node("talker")
    publisher = node.create_publisher(String, "launched", 10)
    def say():
        publisher.publish(String(data=sys.argv[1]))
    say()
    node.create_timer(0.1, say)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass

main()
"""
_LAUNCH = """
from launch import LaunchDescription
from launch.substitutions import PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node

def generate_launch_description():
    talker = PathJoinSubstitution([ThisLaunchFileDir(), "talker.py"])
    return LaunchDescription(
        [Node(executable=talker, name=f"talker_{number}", arguments=[str(number)]) for number in range(NODES)]
    )
"""


def run(plan: Plan) -> Section:
    """Measure one node, and many."""
    cases = [
        Case(f"{nodes} nodes", partial(measure, nodes), BUS.missing(), BUS.name, nodes)
        for nodes in (_FEW, _MANY)
    ]
    outcomes = interleave(cases, plan.choose(1, 5), lambda text: plan.tell(f"{NAME} {text}"))
    heard = [one["heard_s"] for one in outcomes[f"{_MANY} nodes"].repetitions]
    comparisons = compare(f"s until {_MANY} launched nodes are heard", heard, at_most=_GOAL_S)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    title = "Launch files: until the nodes of one are heard"
    return Section(NAME, title, _COLUMNS, rows, comparisons, _NOTES, "number of nodes")


def measure(nodes: int) -> Figures:
    """Measure once. Raises Failure if a node's message does not arrive."""
    with Group() as group, TemporaryDirectory() as folder:
        BUS.start_servers(group)
        Path(folder, "talker.py").write_text(_TALKER)
        path = Path(folder, "all.launch.py")
        path.write_text(_LAUNCH.replace("NODES", str(nodes)))
        wanted = msgspec.json.encode(Heard(_TOPIC, nodes)).decode()
        ear = group.start_python("ear", "-m", "benchmarks.adapters.hearing", wanted)
        group.expect(ear, "ready", within_s=START_S)
        command = (sys.executable, "-m", "bus_cli", "launch", str(path))
        begin_ns = monotonic_ns()
        launch = group.start("launch", *command, environ={"ROS_LOG_DIR": folder}, stop_signal=signal.SIGINT)
        found = group.expect(ear, "heard", within_s=_LIMIT_S)
        cpu_s = launch.cpu_ns() / 1e9
        end_ns = monotonic_ns()
        launch.ask_to_end()
        if not select.select([launch.exit_fd], [], [], STOP_S)[0]:
            raise Failure(f"bus launch did not end within {STOP_S:g} s")
        end_s = (monotonic_ns() - end_ns) / 1e9
        group.let_go(launch)
        return {"heard_s": (found["heard_ns"] - begin_ns) / 1e9, "end_s": end_s, "cpu_s": cpu_s}

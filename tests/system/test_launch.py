"""`bus launch` as a process: its output, its end, and no processes left behind."""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from programs import Program, on_one_loop, running
from semantics import until

LAUNCH = ("-m", "bus_cli", "launch")
TALKER = """#!/usr/bin/env python3
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.declare_parameter("text", "hello")
        self.create_timer(0.05, self.say)

    def say(self):
        self.publisher.publish(String(data=self.get_parameter("text").value))

def main():
    rclpy.init()
    try:
        rclpy.spin(Talker())
    except KeyboardInterrupt:
        pass

main()
"""
LISTENER = """#!/usr/bin/env python3
import rclpy
from std_msgs.msg import String

def main():
    rclpy.init()
    node = rclpy.create_node("listener")
    heard = lambda message: node.get_logger().info("I heard: " + message.data, once=True)
    node.create_subscription(String, "chatter", heard, 10)
    print("listening")
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        print("farewell")

main()
"""
TWO = """
import os
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = os.path.dirname(__file__)

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("text", default_value="hi there"),
        Node(
            executable=os.path.join(HERE, "talker"),
            name="announcer",
            namespace="robot",
            parameters=[{"text": LaunchConfiguration("text")}],
            remappings=[("chatter", "/talk")],
        ),
        Node(executable=os.path.join(HERE, "listener"), output="screen", remappings=[("chatter", "/talk")]),
    ])
"""
# The handlers write by `os`: during the `print` of "ready" they may not print.
STUBBORN = """
import os, signal, time
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda number, frame: os.write(1, b"ignored %d\\n" % number))
print("ready", flush=True)
while True:
    time.sleep(60)
"""


def write(folder: Path, **files: str) -> Path:
    """Writes programs and launch files; the folder."""
    for name, text in files.items():
        path = folder / name.replace("__", ".")
        path.write_text(text)
        path.chmod(0o755)
    return folder


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    (tmp_path / "temporary").mkdir()
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@asynccontextmanager
async def launched(here: Path, *words: str) -> AsyncIterator[Program]:
    async with running(here.parent / "temporary", *LAUNCH, *words) as program:
        yield program


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_two_nodes_talk_and_ctrl_c_ends_all(here: Path) -> None:
    write(here, talker=TALKER, listener=LISTENER, two__launch__py=TWO)
    async with launched(here, "two.launch.py", "text:=5 apples") as launch:
        await launch.line(r"^\[listener-2\] \[INFO\] \[.*\] \[listener\]: I heard: 5 apples$")
        talker, listener = launch.family("talker"), launch.family("listener")
        assert len(talker) == len(listener) == 1
        launch.process.send_signal(signal.SIGINT)
        assert await launch.end() == 0
        assert launch.family() == []
    assert launch.lines[0].startswith(f"[INFO] [launch]: All log files can be found below {here.parent}/log/")
    assert launch.lines[1] == "[INFO] [launch]: Default logging verbosity is set to INFO"
    assert f"[INFO] [talker-1]: process started with pid [{talker[0]}]" in launch.lines
    ended = launch.lines[
        launch.lines.index("[WARNING] [launch]: user interrupted with ctrl-c (SIGINT)") + 1 :
    ]
    assert sorted(ended) == [
        f"[INFO] [listener-2]: process has finished cleanly [pid {listener[0]}]",
        f"[INFO] [talker-1]: process has finished cleanly [pid {talker[0]}]",
        "[listener-2] farewell",
    ]
    assert list((here.parent / "temporary").iterdir()) == []  # no parameter file
    (log,) = (here.parent / "log").glob("*-*/launch.log")
    assert "process started with pid" in log.read_text()


@on_one_loop
async def test_signals_escalate(here: Path) -> None:
    """Also for processes started by a shell."""
    write(
        here,
        stubborn__py=STUBBORN,
        hard__launch__xml="""
            <launch>
              <let name="sigterm_timeout" value="1.5"/><let name="sigkill_timeout" value="1.5"/>
              <executable cmd="python3 $(dirname)/stubborn.py" name="one" output="screen"/>
              <executable cmd="python3 $(dirname)/stubborn.py; true" shell="true" name="sh" output="screen"/>
            </launch>""",
    )
    async with launched(here, "hard.launch.xml") as launch:
        for name in ("one-1", "sh-2"):
            await launch.line(rf"^\[{name}\] ready$")
        launch.process.send_signal(signal.SIGTERM)
        assert await launch.end() == -signal.SIGTERM
        assert launch.family() == []
    said = [line for line in launch.lines if "one-1" in line]
    pid = said[0].partition("pid [")[2].rstrip("]")
    command = f"python3 {here}/stubborn.py"
    assert said[2:] == [
        "[INFO] [one-1]: sending signal 'SIGINT' to process[one-1]",
        "[one-1] ignored 2",
        "[ERROR] [one-1]: process[one-1] failed to terminate '1.5' seconds after receiving 'SIGINT', "
        "escalating to 'SIGTERM'",
        "[INFO] [one-1]: sending signal 'SIGTERM' to process[one-1]",
        "[one-1] ignored 15",
        "[ERROR] [one-1]: process[one-1] failed to terminate '3' seconds after receiving 'SIGTERM', "
        "escalating to 'SIGKILL'",
        "[INFO] [one-1]: sending signal 'SIGKILL' to process[one-1]",
        f"[ERROR] [one-1]: process has died [pid {pid}, exit code -9, cmd '{command}'].",
    ]


SLOW = """
import os, signal, sys
count = 0
def hear(number, frame):
    global count
    count += 1
    os.write(1, b"interrupted %d\\n" % count)
    if count == 2:
        sys.exit()
signal.signal(signal.SIGINT, hear)
print("ready", flush=True)
while True:
    signal.pause()
"""


@on_one_loop
async def test_ctrl_z_and_a_second_ctrl_c_reach_all(here: Path) -> None:
    write(
        here,
        slow__py=SLOW,
        slow__launch__yaml="launch: [{executable: {cmd: python3 slow.py, output: screen}}]",
    )

    def states() -> set[str]:
        family = [*launch.family("slow.py"), launch.process.pid]
        return {Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] for pid in family}

    async with launched(here, "slow.launch.yaml") as launch:
        await launch.line("ready")
        launch.process.send_signal(signal.SIGTSTP)
        await until(lambda: states() == {"T"})
        launch.process.send_signal(signal.SIGCONT)
        await until(lambda: "T" not in states())
        launch.process.send_signal(signal.SIGINT)
        await launch.line("interrupted 1")
        launch.process.send_signal(signal.SIGINT)
        assert await launch.end() == 0
    assert "[WARNING] [launch]: user interrupted with ctrl-c (SIGINT) again, ignoring..." in launch.lines
    assert "[python3-1] interrupted 2" in launch.lines
    assert "process has finished cleanly" in launch.lines[-1]


@on_one_loop
async def test_sigterm_after_a_ctrl_c_is_the_status(here: Path) -> None:
    write(
        here,
        slow__py=SLOW,
        slow__launch__yaml="launch: [{executable: {cmd: python3 slow.py, output: screen}}]",
    )
    async with launched(here, "slow.launch.yaml") as launch:
        await launch.line("ready")
        launch.process.send_signal(signal.SIGINT)
        await launch.line("interrupted 1")
        launch.process.send_signal(signal.SIGTERM)
        for pid in launch.family("slow.py"):
            os.kill(pid, signal.SIGINT)
        assert await launch.end() == -signal.SIGTERM


@on_one_loop
async def test_a_killed_launch_leaves_nothing(here: Path) -> None:
    """Including background processes of a shell."""
    write(
        here,
        two__launch__yaml="""
            launch:
            - executable: {cmd: sleep 1000}
            - executable: {cmd: "sleep 1001 & sleep 1002", shell: true}""",
    )
    async with launched(here, "two.launch.yaml") as launch:
        for number in (
            1,
            2,
        ):  # a launch killed earlier may leave the process that it just started
            await launch.line(rf"^\[INFO\] \[\w+-{number}\]: process started")
        await until(lambda: len(launch.family("sleep 100")) >= 3)
        os.kill(launch.process.pid, signal.SIGKILL)
        await until(lambda: launch.family() == [])


@on_one_loop
async def test_what_a_shell_has_left_ends_with_the_launch(here: Path) -> None:
    write(
        here,
        left__launch__yaml="launch: [{executable: {cmd: 'sleep 1000 >/dev/null 2>&1 &', shell: true}}]",
    )
    async with launched(here, "left.launch.yaml") as launch:
        assert await launch.end() == 0
        assert launch.family() == []


@on_one_loop
async def test_whoever_reads_it_is_gone(here: Path) -> None:
    """As in `bus launch ... | head -1`."""
    write(
        here,
        loud__launch__yaml="launch: [{executable: {cmd: 'yes', output: screen}}]",
    )
    done = await asyncio.create_subprocess_shell(
        f"{sys.executable} -m bus_cli launch loud.launch.yaml | head -5", stdout=asyncio.subprocess.PIPE
    )
    out, _ = await done.communicate()
    assert len(out.splitlines()) == 5


@on_one_loop
async def test_a_launch_file_ends_the_program(here: Path) -> None:
    write(here, enough__launch__py="import sys\nsys.exit('enough')\n")
    words = (sys.executable, "-m", "bus_cli", "launch", "enough.launch.py")
    done = await asyncio.create_subprocess_exec(
        *words, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE
    )
    _, err = await done.communicate()
    assert (done.returncode, err) == (1, b"enough\n")

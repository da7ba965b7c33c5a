"""turtlesim's programs as users run them, without a display."""

import asyncio
import os
import pty
import re
import signal
import sys
import termios
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from bus.node import Node
from bus.types.classes import message_class
from cli import Result, bus
from programs import Program, on_one_loop, running

RUN = ("-m", "bus_cli", "run", "turtlesim")
LAUNCH = ("-m", "bus_cli", "launch")
MIMIC = """
<launch>
  <node pkg="turtlesim" exec="turtlesim_node" name="sim" namespace="turtlesim1"/>
  <node pkg="turtlesim" exec="turtlesim_node" name="sim" namespace="turtlesim2"/>
  <node pkg="turtlesim" exec="mimic" name="mimic">
    <remap from="/input/pose" to="/turtlesim1/turtle1/pose"/>
    <remap from="/output/cmd_vel" to="/turtlesim2/turtle1/cmd_vel"/>
  </node>
</launch>
"""
"""The file in ROS 2's tutorial on launch files."""

pytestmark = pytest.mark.usefixtures("daemon")


class Sim:
    """turtlesim_node, and programs beside it."""

    def __init__(self, stack: AsyncExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        self._looker: Node | None = None
        self.node: Program

    async def run(self, *words: str) -> Program:
        return await self._stack.enter_async_context(running(self._folder, *RUN, *words, DISPLAY=""))

    async def launch(self, *words: str) -> Program:
        """A launch file whose first two nodes are simulators."""
        program = await self._stack.enter_async_context(running(self._folder, *LAUNCH, *words, DISPLAY=""))
        for number in (1, 2):
            await program.line(rf"^\[turtlesim_node-{number}\] .* Spawning turtle \[turtle1\]")
        return program

    async def begin(self, *words: str) -> None:
        self.node = await self.run("turtlesim_node", *words)
        await self.node.line(r"\[turtlesim\]: Spawning turtle \[turtle1\] at x=\[5.544445\], y=\[5.544445\]")

    async def bus(self, *words: str) -> Result:
        return await asyncio.to_thread(bus, *words)

    async def call(self, service: str, kind: str, request: str = "{}") -> str:
        said = await self.bus("service", "call", service, kind, request)
        assert said.code == 0, said.err
        return said.out.partition("response:\n")[2].strip()

    async def pose(self, turtle: str = "turtle1") -> dict[str, float]:
        """The turtle's current pose."""
        now = await self._next("turtlesim/msg/Pose", f"/{turtle}/pose")
        return {name: getattr(now, name) for name in now.__struct_fields__}

    async def colour(self, turtle: str = "turtle1") -> list[int]:
        now = await self._next("turtlesim/msg/Color", f"/{turtle}/color_sensor")
        return [now.r, now.g, now.b]

    async def _next(self, type_name: str, topic: str) -> Any:
        """The next message on the topic."""
        if self._looker is None:
            self._looker = await self._stack.enter_async_context(Node("_looker", arguments=[], rosout=False))
        subscription = await self._looker.create_subscription(message_class(type_name), topic, 1)
        try:
            message, _ = await subscription.receive()
        finally:
            await subscription.close()
        return message

    async def end(self, program: Program, status: int = 0) -> None:
        program.process.send_signal(signal.SIGINT)
        assert await program.end() == status
        assert not [line for line in program.lines if "Traceback" in line]


@pytest.fixture
async def sim(tmp_path: Path) -> Any:
    async with AsyncExitStack() as stack:
        yield Sim(stack, tmp_path)


@on_one_loop
async def test_a_turtle_moves_and_draws(sim: Sim) -> None:
    await sim.begin()
    assert re.match(r"(no )?page: ", sim.node.lines[0])
    assert await sim.pose() == {
        **dict.fromkeys(("x", "y"), 5.544444561004639),
        **dict.fromkeys(("theta", "linear_velocity", "angular_velocity"), 0.0),
    }
    assert await sim.colour() == [0x45, 0x56, 0xFF]
    twist = "{linear: {x: 2.0, y: 1.0}, angular: {z: 1.8}}"
    await sim.bus("topic", "pub", "--once", "/turtle1/cmd_vel", "geometry_msgs/msg/Twist", twist)
    while (pose := await sim.pose())["y"] < 5.6:
        assert pose["linear_velocity"] in (0.0, 2.0)
    await sim.call("/turtle1/set_pen", "turtlesim/srv/SetPen", "{r: 9, g: 8, b: 7, width: 5}")
    await sim.call("/turtle1/teleport_absolute", "turtlesim/srv/TeleportAbsolute", "{x: 20, y: 3}")
    await sim.node.line(
        r"\[WARN\] \S+ \[turtlesim\]: Oh no! I hit the wall! \(Clamping from \[x=2\d\.\d{6}, y="
    )
    assert (await sim.pose())["x"] == 11.088889122009277
    assert await sim.colour() == [9, 8, 7]
    await sim.call("/turtle1/set_pen", "turtlesim/srv/SetPen", "{'off': 1}")
    await sim.call("/clear", "std_srvs/srv/Empty")
    assert (await sim.bus("param", "set", "/turtlesim", "background_r", "150")).code == 0
    assert await sim.colour() == [150, 0x56, 0xFF]
    said = await sim.bus("param", "set", "/turtlesim", "background_r", "300")
    assert said.code == 1
    assert "Parameter background_r out of range. Min: 0, Max: 255, value: 300" in said.err
    await sim.end(sim.node)


@on_one_loop
async def test_turtles_come_and_go(sim: Sim) -> None:
    await sim.begin()
    spawn = "turtlesim/srv/Spawn"
    assert await sim.call("/spawn", spawn, "{x: 2, y: 3, theta: 0.2}") == (
        "turtlesim.srv.Spawn_Response(name='turtle2')"
    )
    assert (await sim.pose("turtle2"))["y"] == 3.0
    await sim.call("/spawn", spawn, "{name: turtle2}")
    await sim.node.line(r"\[ERROR\] \S+ \[turtlesim\]: A turtle named \[turtle2\] already exists$")
    await sim.call("/spawn", spawn, "{name: 'no name'}")
    await sim.node.line(r"Can't spawn a turtle named \[no name\]: ")
    long = "b" * 210  # its services are longer than a topic may be
    await sim.call("/spawn", spawn, f"{{name: {long}}}")
    await sim.node.line(rf"Can't spawn a turtle named \[{long}\]: ")
    await sim.call("/kill", "turtlesim/srv/Kill", f"{{name: {long}}}")
    await sim.call("/spawn", spawn, "{x: .nan}")
    await sim.node.line(r"Can't spawn a turtle at x=\[nan\]")
    await sim.call("/kill", "turtlesim/srv/Kill", "{name: turtle2}")
    await sim.call("/kill", "turtlesim/srv/Kill", "{name: turtle2}")
    await sim.node.line(
        r"\[ERROR\] \S+ \[turtlesim\]: Tried to kill turtle \[turtle2\], which does not exist$"
    )
    assert "/turtle2" not in (await sim.bus("topic", "list")).out
    await sim.bus(
        "topic", "pub", "--once", "/turtle1/cmd_vel", "geometry_msgs/msg/Twist", "linear: {x: .inf}"
    )
    await sim.node.line(r"Ignored a velocity for \[turtle1\] that is not finite: \[x=inf, ")
    await sim.call("/reset", "std_srvs/srv/Empty")
    assert (await sim.pose())["x"] == 5.544444561004639
    await sim.end(sim.node)


@on_one_loop
async def test_it_turns_to_a_heading(sim: Sim) -> None:
    await sim.begin()
    words = ("action", "send_goal", "-f", "/turtle1/rotate_absolute", "turtlesim/action/RotateAbsolute")
    said = await sim.bus(*words, "{theta: 0.5}")
    assert "Feedback:\n    remaining: 0.5\n" in said.out
    delta = re.search(r"Result:\n    delta: (\S+)\n", said.out)
    assert delta is not None
    assert -0.52 < float(delta[1]) < -0.47
    assert said.out.endswith("Goal finished with status: SUCCEEDED\n")
    await sim.node.line("Rotation goal completed successfully$")
    first = asyncio.create_task(sim.bus(*words, "{theta: -1}"))
    while (await sim.pose())["angular_velocity"] != -1.0:
        pass
    await sim.bus(*words, "{theta: 0.5}")
    assert (await first).out.endswith("Goal finished with status: ABORTED\n")
    await sim.node.line("Rotation goal received before a previous goal finished. Aborting previous goal$")
    first = asyncio.create_task(sim.bus(*words, "{theta: -1}"))
    while (await sim.pose())["angular_velocity"] != -1.0:
        pass
    await sim.bus("topic", "pub", "--once", "/turtle1/cmd_vel", "geometry_msgs/msg/Twist")
    assert (await first).out.endswith("Goal finished with status: ABORTED\n")
    await sim.node.line("Velocity command received during rotation goal. Aborting goal$")
    await sim.end(sim.node)


@on_one_loop
async def test_others_move_it(sim: Sim) -> None:
    await sim.begin()
    await sim.call("/spawn", "turtlesim/srv/Spawn", "{x: 2, y: 2}")
    square = await sim.run("draw_square")
    await sim.node.line("Resetting turtlesim.$")
    await square.line(r"\[draw_square\]: New goal \[7.544445 5.544445, 0.000000\]$")
    await sim.call("/spawn", "turtlesim/srv/Spawn", "{x: 2, y: 2}")
    renamed = ("-r", "input/pose:=/turtle1/pose", "-r", "output/cmd_vel:=/turtle2/cmd_vel")
    mimic = await sim.run("mimic", "--ros-args", *renamed)
    while (await sim.pose("turtle2"))["x"] == 2.0:
        pass
    for program in (mimic, square, sim.node):
        await sim.end(program)


@on_one_loop
async def test_a_launch_file_with_a_mimic(sim: Sim, tmp_path: Path) -> None:
    (tmp_path / "mimic_launch.xml").write_text(MIMIC)
    launch = await sim.launch(str(tmp_path / "mimic_launch.xml"))
    circle = ("-r", "20", "/turtlesim1/turtle1/cmd_vel", "geometry_msgs/msg/Twist", "linear: {x: 2}")
    async with running(tmp_path, "-m", "bus_cli", "topic", "pub", *circle):
        while (await sim.pose("turtlesim2/turtle1"))["linear_velocity"] != 2.0:
            pass
    await sim.end(launch)


@on_one_loop
async def test_the_launch_file_that_comes_with_it(sim: Sim) -> None:
    launch = await sim.launch("turtlesim", "multisim.launch.py")
    for number in (1, 2):
        assert (await sim.pose(f"turtlesim{number}/turtle1"))["x"] == 5.544444561004639
    assert (await sim.bus("node", "list")).out == "/turtlesim1/turtlesim\n/turtlesim2/turtlesim\n"
    await sim.end(launch)


@on_one_loop
async def test_keys_steer_it(sim: Sim) -> None:
    await sim.begin()
    async with teleop() as (program, keyboard):
        assert program.stdout is not None
        said = [await program.stdout.readline() for _ in range(5)]
        assert said[0] == b"Reading from keyboard\n"
        assert said[-1] == b"'Q' to quit.\n"
        while (await sim.pose())["x"] < 5.6:
            os.write(keyboard, b"\x1b[A")
        while (await sim.pose())["angular_velocity"] != -1.0:
            os.write(keyboard, b"c")
        os.write(keyboard, b"f")
        await sim.node.line("Rotation goal canceled$")
        os.write(keyboard, b"q")
        assert await program.wait() == 0
    await sim.end(sim.node)


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)])
@on_one_loop
async def test_a_signal_ends_it_and_the_terminal_is_as_before(number: int) -> None:
    async with teleop() as (program, _):
        assert program.stdout is not None
        while await program.stdout.readline() != b"'Q' to quit.\n":
            pass
        program.send_signal(number)
        assert await program.wait() == 0
        assert await program.stdout.read() == b""


@asynccontextmanager
async def teleop() -> AsyncIterator[tuple[asyncio.subprocess.Process, int]]:
    """turtle_teleop_key on a terminal, and the keyboard's end; the terminal's mode must be restored."""
    keyboard, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    program = await asyncio.create_subprocess_exec(
        *(sys.executable, *RUN, "turtle_teleop_key"),
        stdin=terminal,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    try:
        yield program, keyboard
        assert termios.tcgetattr(terminal) == before
    finally:
        if program.returncode is None:
            program.kill()
            await program.wait()
        os.close(keyboard)
        os.close(terminal)


@on_one_loop
async def test_keys_need_a_terminal(sim: Sim) -> None:
    program = await sim.run("turtle_teleop_key")
    assert await program.end() == 1
    assert program.lines[0] == "turtle_teleop_key reads keys from a terminal, and stdin is none"


@pytest.mark.landing
@on_one_loop
async def test_a_turtle_follows_a_frame(sim: Sim, tmp_path: Path) -> None:
    """The demonstration of ROS 2's tutorials on tf2."""
    words = ("turtle_tf2_py", "turtle_tf2_fixed_frame_demo.launch.py", "target_frame:=carrot1")
    async with running(tmp_path, *LAUNCH, *words, DISPLAY="") as demo:
        await demo.line(r"^\[turtle_tf2_listener-4\] .* \[listener\]: Successfully spawned turtle2")

        async def place() -> tuple[float, float]:
            pose = await sim.pose("turtle2")
            return pose["x"], pose["y"]

        # The carrot is two metres to the left of turtle1, which faces right and stands still.
        while abs((await place())[1] - 7.5) > 0.2:
            pass
        assert abs((await place())[0] - 5.5) < 0.2
        await sim.end(demo)


@on_one_loop
async def test_a_turtle_that_does_not_move(sim: Sim, tmp_path: Path) -> None:
    run = ("-m", "bus_cli", "run", "turtle_tf2_py", "static_turtle_tf2_broadcaster")
    async with running(tmp_path, *run, "world", *"123000") as program:
        assert await program.end() == 2
        assert 'Your static turtle name cannot be "world"' in program.lines[-2]
    async with running(tmp_path, *run, "robot", "1", "x", *"0000") as program:
        assert await program.end() == 1
        assert "could not convert string to float: 'x'" in program.lines[-2]
    async with running(tmp_path, *run, "robot", *"123000"):
        late = ("tf2_msgs/msg/TFMessage", "--qos-durability", "transient_local")
        seen = await sim.bus("topic", "echo", "--once", "/tf_static", *late)
    assert "child_frame_id: robot" in seen.out
    assert "z: 3.0" in seen.out

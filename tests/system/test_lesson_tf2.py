"""The lesson's chapter on transforms: its programs, as docs/lesson.md prints them, run together."""

import asyncio
import re
import shlex
import signal
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from cli import bus
from programs import Program, on_one_loop, running

pytestmark = pytest.mark.landing

RUN = ("-m", "bus_cli", "run")
CHAPTER = (
    (Path(__file__).parents[2] / "docs" / "lesson.md")
    .read_text()
    .partition(". Transforms\n")[2]
    .partition("\n## ")[0]
)
PROGRAMS = {
    re.findall(r"`(\w+\.py)`", before)[-1]: program
    for before, program in re.findall(r"(.*?)^```python\n(.*?)^```$", CHAPTER, re.MULTILINE | re.DOTALL)
}
"""Each program's name is the last one in the text before it."""


class Terminals:
    """Programs of the chapter, as if each had its own terminal."""

    def __init__(self, stack: AsyncExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder

    async def run(self, *words: str) -> Program:
        if words[0] in PROGRAMS:
            (self._folder / words[0]).write_text(PROGRAMS[words[0]])
            words = (str(self._folder / words[0]), *words[1:])
        return await self._stack.enter_async_context(running(self._folder, *RUN, *words, DISPLAY=""))


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_a_frame_that_stays(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        terminals = Terminals(stack, tmp_path)
        frame = await terminals.run("static_frame.py", "mystaticturtle", "0", "0", "1", "0", "0", "0")
        echo = await terminals.run("tf2_ros", "tf2_echo", "world", "mystaticturtle")
        await echo.line(r"^- Translation: \[0.000, 0.000, 1.000\]$")
        words = ("/tf_static", "--field", "transforms[0].transform.translation")
        said = await asyncio.to_thread(bus, "topic", "echo", "--once", *words)
        assert said.out == "x: 0.0\ny: 0.0\nz: 1.0\n---\n"
        frame.process.send_signal(signal.SIGINT)
        assert await frame.end() == -signal.SIGINT
        assert frame.lines == []


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_one_turtle_follows_another(tmp_path: Path) -> None:
    assert list(PROGRAMS) == [*("static_frame.py", "turtle_frame.py", "follower.py", "carrot.py", "past.py")]
    async with AsyncExitStack() as stack:
        terminals = Terminals(stack, tmp_path)
        follower = await terminals.run("follower.py", "--ros-args", "-p", "target_frame:=carrot1")
        await follower.line(
            'Could not transform turtle2 to carrot1: "turtle2" passed to lookupTransform argument '
            "target_frame "
            "does not exist. $"
        )
        sim = await terminals.run("turtlesim", "turtlesim_node")
        await sim.line(r"Spawning turtle \[turtle1\]")
        spawn, circle = map(
            shlex.split, re.findall(r"^\$ bus (service call .*|topic pub .*)$", CHAPTER, re.MULTILINE)
        )
        assert "Spawn_Response(name='turtle2')" in (await asyncio.to_thread(bus, *spawn)).out
        await stack.enter_async_context(running(tmp_path, "-m", "bus_cli", *circle))
        await terminals.run("turtle_frame.py", "--ros-args", "-p", "turtlename:=turtle1")
        other = ("-p", "turtlename:=turtle2", "-r", "__node:=other")
        await terminals.run("turtle_frame.py", "--ros-args", *other)
        past = await terminals.run("past.py")
        await past.line(r"turtle1 was -?\d+\.\d\d m ahead of turtle2$")
        await terminals.run("carrot.py")
        echo = await terminals.run("tf2_ros", "tf2_echo", "turtle1", "carrot1", "20")
        await echo.line(r"^- Translation: \[-?0.000, -?2.000, 0.000\]$")
        said = await asyncio.to_thread(
            bus, *["topic", "echo", "--once", "/turtle2/cmd_vel", "--field", "linear.x"]
        )
        assert float(said.out.partition("\n")[0]) > 0
        for program in (echo, past, follower):
            program.process.send_signal(signal.SIGINT)
            assert await program.end() in (0, -signal.SIGINT)
    assert not [line for line in (*past.lines, *follower.lines) if "Traceback" in line]

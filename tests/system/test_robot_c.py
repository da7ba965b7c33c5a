"""The example robot with a camera in C and a controller in C++, run as users run it."""

import re
import signal
from pathlib import Path

import pytest

import c_programs
from bus import shm
from programs import EXAMPLES, assert_nothing_is_left, on_one_loop, running

ROBOT = EXAMPLES / "robot"


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
@on_one_loop
async def test_it_runs_until_ctrl_c(programs: Path, tmp_path: Path) -> None:
    build = {"BUILD": str(programs), "SANITIZE": c_programs.SANITIZE, "CFLAGS": "-O1 -Werror"}
    async with running(tmp_path, ROBOT / "main.py", "--c", **build) as robot:
        await robot.line(r"^/camera/image_raw +30 +[1-9]")
        await robot.line(r"^/cmd_vel +30 +[1-9]")
        robot.process.send_signal(signal.SIGINT)
        assert await robot.end() == 0, robot.lines
    assert robot.lines[0] == "building the camera (C) and the controller (C++)"
    published = await robot.line(r"^camera \(C\): (\d+) images published$")
    found = await robot.line(
        r"^controller \(C\+\+\): (\d+) images, (\d+) in shared memory; the ball is \d+ degrees"
    )
    assert int(published[1]) >= int(found[1]) > 0
    assert int(found[2]) == (int(found[1]) if shm.is_available() else 0)
    assert not [line for line in robot.lines if re.search("Traceback|ERROR|WARN", line)]
    assert_nothing_is_left(robot, tmp_path)


@on_one_loop
async def test_without_a_compiler_one_line_says_so(tmp_path: Path) -> None:
    async with running(tmp_path, ROBOT / "main.py", "--c", PATH=str(tmp_path), CC="gcc", CXX="g++") as robot:
        assert await robot.end() == 1
    reason = "a camera in C and a controller in C++ need a compiler: there is no make, no gcc, no g++"
    assert robot.lines == [f"The robot failed: {reason}."]

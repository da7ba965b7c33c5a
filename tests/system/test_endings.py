"""Programs ended by Ctrl-C and SIGTERM: they clean up, print nothing, and die of that signal."""

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from conftest import WAIT_S
from programs import on_one_loop, running

pytestmark = pytest.mark.usefixtures("daemon")

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
RUN = ("-m", "bus_cli", "run")
WAYS = pytest.mark.parametrize("way", [(), RUN], ids=["python", "bus run"])

NATIVE = """\
import asyncio, atexit, signal, sys
import bus

async def stay():
    try:
        await asyncio.sleep(1000)
    finally:
        print("a task ends", flush=True)

async def main():
    async with bus.Node("stays") as node:
        task = asyncio.create_task(stay())
        await asyncio.sleep(0)
        print("up", flush=True)
        try:
            await node.spin()
        finally:
            print("main ends", flush=True)
"""


def script(folder: Path, text: str) -> Path:
    path = folder / "program.py"
    path.write_text(text)
    return path


async def ended(
    folder: Path, number: int, way: Sequence[str], text: str, **variables: str
) -> tuple[int, list[str]]:
    """The status of a program that gets a signal once it is up, and its lines after that."""
    async with running(folder, *way, script(folder, text), **variables) as program:
        await program.line("^up$")
        program.process.send_signal(number)
        status = await program.end()
    assert program.lines[0] == "up"
    return status, program.lines[1:]


# --- bus.run


@BOTH
@WAYS
@on_one_loop
async def test_it_cleans_up_and_dies_by_the_signal(tmp_path: Path, way: Sequence[str], number: int) -> None:
    text = f"""{NATIVE}
log = open({str(tmp_path / "log")!r}, "w")
log.write("left open")
atexit.register(print, "at exit")
try:
    bus.run(main())
    print("went on")
finally:
    print("finally")
"""
    said = ["main ends", "a task ends", "finally", "at exit"]
    assert await ended(tmp_path, number, way, text) == (-number, said)
    assert (tmp_path / "log").read_text() == "left open"


@BOTH
@on_one_loop
async def test_a_program_that_catches_it_goes_on(tmp_path: Path, number: int) -> None:
    text = f"""{NATIVE}
try:
    bus.run(main())
except KeyboardInterrupt:
    print("caught")
print(bus.run(asyncio.sleep(0, "again")))
sys.exit(3)
"""
    assert await ended(tmp_path, number, (), text) == (3, ["main ends", "a task ends", "caught", "again"])


@BOTH
@on_one_loop
async def test_a_main_that_catches_its_cancellation_returns(tmp_path: Path, number: int) -> None:
    text = f"""{NATIVE}
async def calm():
    try:
        await main()
    except asyncio.CancelledError:
        return "calm"
print(bus.run(calm()))
"""
    assert await ended(tmp_path, number, (), text) == (0, ["main ends", "a task ends", "calm"])


@on_one_loop
async def test_a_handler_of_the_programs_own(tmp_path: Path) -> None:
    text = f"""{NATIVE}
signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
bus.run(main())
"""
    status, said = await ended(tmp_path, signal.SIGTERM, (), text)
    assert (status, [line for line in said if "Traceback" in line]) == (7, [])


@on_one_loop
async def test_sys_exit_in_a_task(tmp_path: Path) -> None:
    """As if the handler of the test above had interrupted a task of `bus`, for example one of a node."""
    text = f"""{NATIVE}
async def leave():
    await asyncio.sleep(0.001)
    sys.exit(7)

async def begin():
    asyncio.create_task(leave())
    await main()

bus.run(begin())
"""
    async with running(tmp_path, script(tmp_path, text)) as program:
        assert (await program.end(), [line for line in program.lines if "Traceback" in line]) == (7, [])


@on_one_loop
async def test_errors_are_told_as_ever_after_ctrl_c(tmp_path: Path) -> None:
    text = f"""{NATIVE}
try:
    bus.run(main())
except KeyboardInterrupt:
    raise ValueError("mine") from None
"""
    status, said = await ended(tmp_path, signal.SIGINT, (), text)
    assert (status, said[-1]) == (1, "ValueError: mine")


# --- in a shell

LOOPS = {
    "bus.run": f"{NATIVE}bus.run(main())\n",
    "rclpy": (
        "import bus.rclpy_compat, rclpy\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('n')\n"
        "print('up', flush=True)\n"
        "rclpy.spin(node)\n"
    ),
}


def after_ctrl_c(command: str, says: bytes = b"up") -> tuple[int, str]:
    """Types Ctrl-C on a terminal once a `command` prints `says`; the status of bash, and all output."""
    loop = f"for i in 1 2 3; do {command}; done; echo went on"
    pid, terminal = pty.fork()
    if not pid:
        signal.alarm(int(WAIT_S))
        os.execvp("bash", ["bash", "-c", loop])
    text, is_typed = b"", False
    try:
        while True:
            try:
                text += os.read(terminal, 4096)
            except OSError:  # the other end is closed
                break
            if says in text and not is_typed:
                is_typed = True
                os.write(terminal, b"\x03")
    finally:
        os.close(terminal)
        _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status), text.decode()


@pytest.mark.parametrize("kind", LOOPS)
@WAYS
def test_one_ctrl_c_ends_a_loop_of_the_shell(tmp_path: Path, kind: str, way: Sequence[str]) -> None:
    command = " ".join([sys.executable, *way, str(script(tmp_path, LOOPS[kind]))])
    status, text = after_ctrl_c(command)
    assert status == -signal.SIGINT, text
    assert "Traceback" not in text and "went on" not in text and text.count("up") == 1


def test_one_ctrl_c_ends_a_loop_of_bus(tmp_path: Path) -> None:
    # Not earlier: before Python runs, no code of bus can catch the signal.
    command = f"{sys.executable} -m bus_cli topic echo /nothing std_msgs/msg/String"
    status, text = after_ctrl_c(command, b"no node publishes")
    assert status == -signal.SIGINT, text
    assert "Traceback" not in text and "went on" not in text


# --- rclpy

SHUTS_DOWN = """\
import threading, time
import rclpy
from rclpy.executors import {executor}

rclpy.init()
node = rclpy.create_node('n')
executor = {executor}()
executor.add_node(node)
{how}
executor.spin()
print('went on')
"""


def result_of(folder: Path, way: Sequence[str], text: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *way, str(script(folder, text))]
    return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)


def test_a_callback_of_many_threads_that_shuts_down_is_no_failure(tmp_path: Path) -> None:
    how = "node.create_timer(0.01, lambda: (time.sleep(0.1), rclpy.shutdown()))"
    done = result_of(tmp_path, RUN, SHUTS_DOWN.format(executor="MultiThreadedExecutor", how=how))
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\n", "")


def test_another_threads_shutdown_is_an_error_as_in_rclpy(tmp_path: Path) -> None:
    """No signal came, so the exit status must not look like one."""
    how = "threading.Timer(0.2, rclpy.shutdown).start()"
    done = result_of(tmp_path, RUN, SHUTS_DOWN.format(executor="SingleThreadedExecutor", how=how))
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines()[-1].endswith("ExternalShutdownException: Context has been shutdown")


# --- while it is still loading

LOADING = """
import os, signal, sys

class Interrupt:
    left = int(sys.argv.pop(1))
    is_near = False

    def find_spec(self, name, path=None, target=None):
        self.is_near |= "bus_cli.entry" in sys.modules or name == "bus.process.termination"
        self.left -= self.is_near
        if self.is_near and not self.left:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
"""
STARTS = {
    "bus": "from bus_cli.entry import main; main()",
    "launched": "import runpy; runpy._run_module_as_main('bus_launch.python_program', alter_argv=False)",
}


@pytest.mark.parametrize(
    ("modules", "start", "line"),
    [
        (1, "bus", "topic list"),
        (12, "bus", "topic echo /topic"),
        (20, "bus", "run tf2_ros tf2_echo a b"),
        (60, "bus", "run turtlesim mimic"),
        (60, "bus", "launch turtlesim multisim.launch.py"),
        (1, "launched", "program.py --"),
        (4, "launched", "program.py --"),
    ],
)
def test_while_modules_load(tmp_path: Path, modules: int, start: str, line: str) -> None:
    """Ctrl-C ends it without output, whichever module it is importing."""
    command = [sys.executable, "-c", LOADING + STARTS[start], str(modules), *line.split()]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, cwd=tmp_path, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, "", "")

"""Programs of the facade, run as a user would run them: one test for each habit they rely on."""

import ast
import os
import re
import signal
from pathlib import Path

import pytest

import bus
from bus import shm
from bus.msg.std_msgs import String
from conftest import Daemon
from packaged import Result, run_bus
from programs import on_one_loop, running
from semantics import until

pytestmark = pytest.mark.usefixtures("daemon")

HABITS = Path(__file__).parents[1] / "lesson" / "habits"
"""A folder of programs; each docstring has the program's output."""

BEGIN = """\
import os, sys, threading, time
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

def until(condition):
    while not condition():
        time.sleep(0.001)

"""
"""`until` waits without a spinning thread."""


def script(folder: Path, text: str) -> Path:
    path = folder / "program.py"
    path.write_text(BEGIN + text)
    return path


def run(folder: Path, text: str, *words: str) -> Result:
    return run_bus("run", str(script(folder, text)), *words)


# --- one process: its output


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("name", sorted(path.stem for path in HABITS.glob("*.py")))
def test_a_habit(name: str) -> None:
    path = HABITS / f"{name}.py"
    expected = (ast.get_docstring(ast.parse(path.read_text()), clean=False) or "").partition("Prints:\n\n")[2]
    assert expected
    assert run_bus("run", str(path)) == (expected, "", 0)


# --- logging


@pytest.mark.parametrize("level", ["", "debug", "error"])
def test_the_log(tmp_path: Path, level: str) -> None:
    """On stderr and without colour; the program's own prints go to stdout."""
    text = """
rclpy.init()
logger = Node('n', namespace='left/arm').get_logger()
logger.debug('text')
logger.info('text')
logger.warning('text')
logger.error('text')
logger.fatal('text')
print('printed')
rclpy.logging.get_logger('free').info('text')
"""
    out, err, code = run(tmp_path, text, *(["--ros-args", "--log-level", level] if level else []))
    assert (out, code) == ("printed\n", 0)
    said = [
        re.fullmatch(r"\[(\w+)\] \[\d{10}\.\d{9}\] \[([\w.]+)\]: text", line) for line in err.splitlines()
    ]
    words = ["DEBUG", "INFO", "WARN", "ERROR", "FATAL"]
    least = words.index(level.upper() or "INFO")
    expected = [(word, "left.arm.n") for word in words[least:]] + [("INFO", "free")] * (least <= 1)
    assert [one and one.groups() for one in said] == expected, err


@on_one_loop
async def test_a_best_effort_publisher_and_a_reliable_reader(tmp_path: Path) -> None:
    """They don't match, and both ends report it."""
    text = """
from rclpy.qos import QoSProfile, ReliabilityPolicy
rclpy.init()
node, other = Node('reader'), Node('writer')
node.create_subscription(String, 't', print, 10)
weak = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
publisher = other.create_publisher(String, 't', weak)
publisher.publish(String(data='lost'))
until(lambda: node.count_publishers('t'))
print(publisher.get_subscription_count(), flush=True)
rclpy.spin(node)
"""
    async with running(tmp_path, "-m", "bus_cli", "run", script(tmp_path, text)) as program:
        await program.line("^0$")
        for name, other in (("reader", "publisher"), ("writer", "subscription")):
            told = rf"New {other} discovered on topic '/t', .*incompatible QoS.*RELIABILITY"
            await program.line(rf"\[WARN\] \[\d{{10}}\.\d{{9}}\] \[{name}\]: {told}")
        program.process.send_signal(signal.SIGINT)
        assert await program.end() == -signal.SIGINT
    assert len(program.lines) == 3


# --- errors

SPINS = ("rclpy.spin(node)", "rclpy.spin_once(node)", "many.spin()")


@pytest.mark.parametrize(
    ("spin", "kind"),
    [
        pytest.param(spin, kind, marks=() if spin == SPINS[0] or kind == "timer" else pytest.mark.nightly)
        for kind in ("timer", "subscription", "async")
        for spin in SPINS
    ],
)
def test_an_error_in_a_callback_leaves_spin(tmp_path: Path, spin: str, kind: str) -> None:
    text = f"""
rclpy.init()
node = Node('n')
def fail(*_):
    raise ValueError('no good')
async def fail_later(*_):
    fail()
if {kind!r} == 'timer':
    node.create_timer(0.001, fail)
else:
    node.create_subscription(String, 't', fail if {kind!r} == 'subscription' else fail_later, 10)
node.create_publisher(String, 't', 10).publish(String())
if 'many' in {spin!r}:
    many = rclpy.executors.MultiThreadedExecutor(2)
    many.add_node(node)
{spin}
print('went on')
"""
    out, err, code = run(tmp_path, text)
    assert (out, code) == ("", 1)
    assert err.startswith("Traceback (most recent call last):\n")
    assert f'program.py", line {BEGIN.count(chr(10)) + 5}, in fail\n    raise ValueError(' in err
    assert err.endswith("\nValueError: no good\n")


def test_shutdown_twice_is_an_error(tmp_path: Path) -> None:
    out, err, code = run(tmp_path, "rclpy.init()\nrclpy.shutdown()\nrclpy.shutdown()\n")
    assert (out, code) == ("", 1)
    assert err.endswith("RuntimeError: Context must be initialized before it can be shutdown\n")


# --- ends: published messages are delivered

ENDS = {
    "without shutdown": ("", 0),
    "shutdown": ("rclpy.shutdown()", 0),
    "all in order": ("node.destroy_node()\nrclpy.shutdown()", 0),
    "sys.exit": ("sys.exit(3)", 3),
    "an error": ("1 / 0", 1),
    "the publisher is gone": ("node.destroy_publisher(publisher)", 0),
}


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("end", ENDS)
@on_one_loop
async def test_nothing_is_lost_at_the_end(tmp_path: Path, end: str) -> None:
    """Even if the program only publishes more than fits into a socket, and never spins."""
    last, code = ENDS[end]
    text = f"""
rclpy.init()
node = Node('n')
publisher = node.create_publisher(String, 't', 1000)
until(publisher.get_subscription_count)
for number in range(500):
    publisher.publish(String(data=str(number) * 2000))
{last}
"""
    async with bus.Node("listener", arguments=()) as node:
        subscription = await node.create_subscription(String, "t", 1000)
        async with running(tmp_path, "-m", "bus_cli", "run", script(tmp_path, text)) as program:
            assert await program.end() == code, program.lines
        heard = [(await subscription.receive())[0].data for _ in range(500)]
        async with bus.Node("look", arguments=()) as other:
            graph = await other.graph()
    assert heard == [str(number) * 2000 for number in range(500)]
    assert sorted(one.name for one in graph.nodes) == ["listener", "look"]
    assert program.family() == []


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not() or "-")
@on_one_loop
async def test_a_flood_wakes_each_subscription_that_it_has_counted(tmp_path: Path) -> None:
    """Even if the event loop never runs again: the talker holds its guard until the listener has heard."""
    sign = tmp_path / "heard"
    listening, talking = tmp_path / "listening", tmp_path / "talking"
    listening.mkdir()
    talking.mkdir()
    listener_text = f"""
rclpy.init()
node = Node('listener')
node.create_subscription(String, 't', lambda message: open({str(sign)!r}, 'w').close(), 10)
print('ready', flush=True)
rclpy.spin(node)
"""
    talker_text = f"""
from bus_ros.engine import engine
rclpy.init()
publisher = Node('talker').create_publisher(String, 't', 10)
until(lambda: publisher.native.matches)
print('counted', publisher.get_subscription_count(), flush=True)
until(publisher.get_subscription_count)
with engine().loop:
    while not os.path.exists({str(sign)!r}):
        publisher.publish(String(data='flood'))
print('heard', flush=True)
"""
    async with running(tmp_path, "-m", "bus_cli", "run", script(listening, listener_text)) as listener:
        await listener.line("ready")
        os.kill(listener.process.pid, signal.SIGSTOP)  # busd matches both, and it can't be woken yet
        async with running(tmp_path, "-m", "bus_cli", "run", script(talking, talker_text)) as talker:
            assert (await talker.line("^counted")).string == "counted 0"
            os.kill(listener.process.pid, signal.SIGCONT)
            await talker.line("^heard$")
            assert await talker.end() == 0
        listener.process.send_signal(signal.SIGINT)
        assert await listener.end() == -signal.SIGINT


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("begin", ["context = rclpy.Context()", "context = None; rclpy.shutdown()"])
@on_one_loop
async def test_a_child_has_a_life_of_its_own(tmp_path: Path, begin: str) -> None:
    """After os.fork the child starts anew and ends in order, and the parent continues."""
    text = f"""
rclpy.init()
node = Node('parent')
publisher = node.create_publisher(String, 't', 10)
rclpy.spin_once(node, timeout_sec=0)
child = os.fork()
if not child:
    {begin}
    with rclpy.init(context=context):
        other = Node('child', context=context)
        talk = other.create_publisher(String, 't', 10)
        other.create_timer(0.001, lambda: talk.publish(String(data='child')))
        until(talk.get_subscription_count)
        rclpy.spin_once(other)
    sys.exit(3)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
until(publisher.get_subscription_count)
publisher.publish(String(data='parent'))
"""
    async with bus.Node("listener", arguments=()) as node:
        subscription = await node.create_subscription(String, "t", 10)
        async with running(tmp_path, "-m", "bus_cli", "run", script(tmp_path, text)) as program:
            assert await program.end() == 0, program.lines
        assert [(await subscription.receive())[0].data for _ in range(2)] == ["child", "parent"]
    assert program.lines == ["3"]


def test_a_child_that_only_ends(tmp_path: Path) -> None:
    """Nothing of the parent's node is delivered or awaited there; its use raises an error."""
    text = """
rclpy.init()
node = Node('parent')
publisher = node.create_publisher(String, 't', 10)
child = os.fork()
if not child:
    try:
        publisher.publish(String())
    except Exception as error:
        print(type(error).__name__, flush=True)
    node.destroy_node()
    sys.exit()
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert run(tmp_path, text) == ("ForkError\n0\n", "", 0)


@on_one_loop
async def test_a_daemon_that_dies_and_comes_back(tmp_path: Path, daemon: Daemon, route: str) -> None:
    """Subscription counts and delivery are restored without any action of the program."""
    text = """
rclpy.init()
node = Node('n')
publisher = node.create_publisher(String, 't', 10)
until(publisher.get_subscription_count)
print('matched', flush=True)
rate = node.create_rate(100)
while rclpy.ok():
    publisher.publish(String(data='x'))
    rate.sleep()
"""
    async with bus.Node("listener", arguments=()) as node:
        subscription = await node.create_subscription(String, "t", 10)
        async with running(tmp_path, "-m", "bus_cli", "run", script(tmp_path, text)) as program:
            await program.line("matched")
            for _ in range(2):
                daemon.kill()
                await until(lambda: not subscription.get_publisher_count())
                daemon.restart()
                await until(subscription.get_publisher_count)
                await subscription.receive()
            program.process.send_signal(signal.SIGINT)
            assert await program.end() == -signal.SIGINT, program.lines
    assert not any("Traceback" in line for line in program.lines)

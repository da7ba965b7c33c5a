"""Ctrl-C and SIGTERM in programs of the facade: the exception, its place, and the state afterwards."""

import asyncio
import random
import re
import signal
import textwrap
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from effort import examples
from programs import Program, on_one_loop, running
from semantics import until

pytestmark = pytest.mark.usefixtures("daemon")

BEGIN = """\
import rclpy, threading, time
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Empty

rclpy.init()
node = rclpy.create_node('tester')
publisher = node.create_publisher(String, 'talk', 10)
"""
UP = "print('up', flush=True)\n"
"""The place in a program at which it is ready for a signal: inside the `try` that catches the exception."""

CAUGHT = """\
try:
    print('up', flush=True)
{what}
    print('went on', flush=True)
except KeyboardInterrupt:
    publisher.publish(String(data='farewell'))
    node.get_logger().info('caught')
finally:
    node.destroy_node()
    rclpy.shutdown()
try:
    rclpy.shutdown()
except RuntimeError as error:
    print(error)
"""

WAITS = {
    "spin": "rclpy.spin(node)",
    "spin_once": "rclpy.spin_once(node)",
    "spin_once in a loop": "while rclpy.ok():\n    rclpy.spin_once(node, timeout_sec=0.1)",
    "spin_until_future_complete": "rclpy.spin_until_future_complete(node, Future())",
    "an executor": "executor = SingleThreadedExecutor()\nexecutor.add_node(node)\nexecutor.spin()",
    "an executor of many threads": (
        "executor = MultiThreadedExecutor(2)\nexecutor.add_node(node)\nexecutor.spin()"
    ),
    "an executor whose threads are at work": (
        "executor = MultiThreadedExecutor(2)\nexecutor.add_node(node)\n"
        "node.create_timer(0.01, lambda: time.sleep(0.1))\nexecutor.spin()"
    ),
    "sleep": "while rclpy.ok():\n    publisher.publish(String(data='x'))\n    time.sleep(0.05)",
    "a long sleep": "time.sleep(1000)",
    "a rate beside a thread that spins": (
        "threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()\n"
        "rate = node.create_rate(20)\nwhile rclpy.ok():\n    rate.sleep()"
    ),
    "a slow rate": "rate = node.create_rate(0.001)\nrate.sleep()",
    "a clock": "node.get_clock().sleep_for(Duration(seconds=1000))",
    "wait_for_service": "node.create_client(Empty, 'nobody').wait_for_service()",
    "wait_for_service in a loop": (
        "client = node.create_client(Empty, 'nobody')\n"
        "while not client.wait_for_service(timeout_sec=0.1):\n    pass"
    ),
    "call": "node.create_client(Empty, 'nobody').call(Empty.Request())",
    "call beside a thread that spins": (
        "threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()\n"
        "node.create_client(Empty, 'nobody').call(Empty.Request())"
    ),
    "a callback that sleeps": "node.create_timer(0.01, lambda: time.sleep(1000))\nrclpy.spin(node)",
    "a callback that calls": (
        "client = node.create_client(Empty, 'nobody', callback_group=ReentrantCallbackGroup())\n"
        "node.create_timer(0.01, lambda: client.call(Empty.Request()))\nrclpy.spin(node)"
    ),
    "a lock": "threading.Event().wait()",
}
"""Calls in which Ctrl-C may find a program."""

DAILY_UNCAUGHT = (
    "spin",
    "an executor of many threads",
    "a rate beside a thread that spins",
    "a clock",
    "call",
)
"""One of each kind: for each call, `test_ctrl_c_that_is_caught` sees daily that the exception leaves it."""


def program(folder: Path, text: str) -> tuple[str | Path, ...]:
    script = folder / "program.py"
    script.write_text(text)
    return "-m", "bus_cli", "run", script


def caught(what: str) -> str:
    return BEGIN + CAUGHT.format(what=textwrap.indent(what, "    "))


async def rest(program: Program) -> None:
    """Wait until the program is up and its main thread sleeps."""
    await program.line("^up$")
    stat = Path(f"/proc/{program.process.pid}/stat")
    await until(lambda: stat.read_text().rpartition(")")[2].split()[0] == "S")


async def settled(program: Program) -> None:
    """Like `rest`, but it has slept for a while: it does not only wait for another of its own threads."""
    await rest(program)
    status = Path(f"/proc/{program.process.pid}/status")
    seen: list[list[str]] = []

    def is_still() -> bool:
        lines = status.read_text().splitlines()
        seen.append([line for line in lines if line.startswith(("State:", "voluntary_ctxt_switches:"))])
        return "S (sleeping)" in seen[-1][0] and seen[-10:] == [seen[-1]] * 10

    await until(is_still)


# --- SIGINT


@pytest.mark.parametrize("where", WAITS)
@on_one_loop
async def test_ctrl_c_that_is_caught(tmp_path: Path, where: str) -> None:
    """The farewell is delivered, a second shutdown is an error, and there is no other output."""
    async with bus.Node("listener", arguments=()) as node:
        subscription = await node.create_subscription(String, "talk", 1000)
        async with running(tmp_path, *program(tmp_path, caught(WAITS[where]))) as one:
            await rest(one)
            one.process.send_signal(signal.SIGINT)
            assert await one.end() == 0, one.lines
            while (await subscription.receive())[0].data != "farewell":
                pass
    up, said, error = one.lines
    assert re.fullmatch(r"\[INFO\] \[\d{10}\.\d{9}\] \[tester\]: caught", said)
    assert (up, error) == ("up", "Context must be initialized before it can be shutdown")
    assert one.family() == []


@pytest.mark.parametrize(
    "where",
    [
        *DAILY_UNCAUGHT,
        *(pytest.param(one, marks=pytest.mark.nightly) for one in WAITS if one not in DAILY_UNCAUGHT),
    ],
)
@on_one_loop
async def test_ctrl_c_that_nobody_catches(tmp_path: Path, where: str) -> None:
    text = f"{BEGIN}{UP}{WAITS[where]}\nprint('went on')\n"
    async with running(tmp_path, *program(tmp_path, text)) as one:
        await rest(one)
        one.process.send_signal(signal.SIGINT)
        assert await one.end() == -signal.SIGINT, one.lines
    assert one.lines == ["up"]
    assert one.family() == []


@pytest.mark.parametrize("where", ["spin", "sleep", "wait_for_service"])
@on_one_loop
async def test_ctrl_c_without_bus_run(tmp_path: Path, where: str) -> None:
    """It prints nothing and dies of the signal, so a shell can see that."""
    text = f"import bus.rclpy_compat\n{BEGIN}{UP}{WAITS[where]}\nprint('went on')\n"
    async with running(tmp_path, program(tmp_path, text)[-1]) as one:
        await rest(one)
        one.process.send_signal(signal.SIGINT)
        assert await one.end() == -signal.SIGINT, one.lines
    assert one.lines == ["up"]


@on_one_loop
async def test_a_thread_that_spins_says_nothing(tmp_path: Path) -> None:
    """The end is not the program's mistake, so it prints nothing."""
    text = f"""{BEGIN}
thread = threading.Thread(target=rclpy.spin, args=(node,))
thread.start()
try:
    {UP}
    time.sleep(1000)
except KeyboardInterrupt:
    thread.join()
    print('joined')
"""
    async with running(tmp_path, *program(tmp_path, text)) as one:
        await rest(one)
        one.process.send_signal(signal.SIGINT)
        assert await one.end() == 0
    assert one.lines == ["up", "joined"]


@on_one_loop
async def test_a_program_may_go_on_after_ctrl_c(tmp_path: Path) -> None:
    text = f"""{BEGIN}
try:
    {UP}
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
rclpy.try_shutdown()
rclpy.init()
other = rclpy.create_node('other')
print(rclpy.ok(), other.get_name(), flush=True)
rclpy.spin(other)
"""
    async with running(tmp_path, *program(tmp_path, text)) as one:
        await rest(one)
        one.process.send_signal(signal.SIGINT)
        await one.line("True other")
        one.process.send_signal(signal.SIGINT)
        assert await one.end() == -signal.SIGINT
    assert one.lines == ["up", "True other"]


@on_one_loop
async def test_handlers_of_the_programs_own(tmp_path: Path) -> None:
    """A handler installed before `init` is called too; with SignalHandlerOptions.NO it is the only one."""
    text = f"""
import os, signal
told = []
def tell(*_):
    told.append('mine')
    os.write(1, b'mine\\n')  # the program may be in a print just now
signal.signal(signal.SIGINT, tell)
{BEGIN}{UP}
while rclpy.ok():
    time.sleep(0.01)
rclpy.try_shutdown()
from rclpy.signals import SignalHandlerOptions
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
print('again', flush=True)
while len(told) < 2:
    time.sleep(0.01)
print(rclpy.ok())
"""
    async with running(tmp_path, *program(tmp_path, text)) as one:
        await rest(one)
        one.process.send_signal(signal.SIGINT)
        await one.line("again")
        one.process.send_signal(signal.SIGINT)
        assert await one.end() == 0
    assert one.lines == ["up", "mine", "again", "mine", "True"]


# --- SIGTERM


@pytest.mark.parametrize(
    ("where", "ends"),
    [
        ("spin", "ExternalShutdownException"),
        ("spin_once", "ExternalShutdownException"),
        ("spin_until_future_complete", "ExternalShutdownException"),
        ("an executor", "ExternalShutdownException"),
        ("an executor of many threads", "ExternalShutdownException"),
        ("a slow rate", "ROSInterruptException"),
        ("sleep", "went on"),
        ("a clock", "went on"),
        ("wait_for_service", "went on"),
        ("call", "went on"),
    ],
)
@on_one_loop
async def test_sigterm(tmp_path: Path, where: str, ends: str) -> None:
    text = f"""{BEGIN}
try:
    {UP}
{textwrap.indent(WAITS[where], "    ")}
    print('went on', flush=True)
except (ExternalShutdownException, ROSInterruptException) as error:
    print(type(error).__name__, flush=True)
print(rclpy.ok())
node.destroy_node()
rclpy.shutdown()
"""
    async with running(tmp_path, *program(tmp_path, text)) as one:
        await settled(one)
        one.process.send_signal(signal.SIGTERM)
        assert await one.end() == 0, one.lines
    assert one.lines == ["up", ends, "False"]


@pytest.mark.parametrize("way", [slice(None), slice(-1, None)], ids=["bus run", "python"])
@on_one_loop
async def test_sigterm_that_nobody_catches(tmp_path: Path, way: slice) -> None:
    text = f"import bus.rclpy_compat\n{BEGIN}{UP}rclpy.spin(node)\n"
    async with running(tmp_path, *program(tmp_path, text)[way]) as one:
        await settled(one)
        one.process.send_signal(signal.SIGTERM)
        assert await one.end() == -signal.SIGTERM
    assert one.lines == ["up"]


# --- at random moments

BUSY = {
    "publishing": "while True:\n    publisher.publish(String(data='x'))",
    "in callbacks": (
        "node.create_subscription(String, 'talk', lambda message: publisher.publish(message), 10)\n"
        "for _ in range(5):\n    publisher.publish(String(data='x'))\nrclpy.spin(node)"
    ),
    "in timers": "for _ in range(5):\n    node.create_timer(1e-4, lambda: None)\nrclpy.spin(node)",
    "in loggers": "while True:\n    node.get_logger().debug('x')\n    node.get_logger().info('working')",
    "spin_once": "while True:\n    rclpy.spin_once(node, timeout_sec=0)",
    "spin_once with traffic": (
        "node.create_subscription(String, 'talk', lambda message: None, 10)\n"
        "while True:\n    publisher.publish(String(data='x'))\n    rclpy.spin_once(node, timeout_sec=0.001)"
    ),
    "making things": (
        "while True:\n    node.destroy_subscription("
        "node.create_subscription(String, 'talk', lambda message: None, 10))"
    ),
    "calling": (
        "other = Node('server')\n"
        "other.create_service(Empty, 'empty', lambda request, response: response)\n"
        "executor = SingleThreadedExecutor()\nexecutor.add_node(other)\n"
        "threading.Thread(target=executor.spin, daemon=True).start()\n"
        "client = node.create_client(Empty, 'empty')\nclient.wait_for_service()\n"
        "while True:\n    client.call(Empty.Request())"
    ),
    "many threads": (
        "executor = MultiThreadedExecutor(3)\nexecutor.add_node(node)\ngroup = ReentrantCallbackGroup()\n"
        "for _ in range(4):\n"
        "    node.create_timer(1e-3, lambda: publisher.publish(String()), callback_group=group)\n"
        "executor.spin()"
    ),
    "destructors": (
        "class Slow:\n    def __del__(self):\n        time.sleep(0.01)\n"
        "while True:\n    Slow()\n    time.sleep(0.005)"
    ),
    "rates": "rate = node.create_rate(5000)\nwhile True:\n    rate.sleep()",
}
STARTS = 5


NOISE = re.compile(r": working$|: [\d,]+ messages on '/talk' were published without a pause, ")
"""Lines that a busy program may print itself."""


@pytest.mark.parametrize("busy", BUSY)
@on_one_loop
async def test_ctrl_c_at_a_random_moment(tmp_path: Path, busy: str) -> None:
    """It is never lost, comes only once, and leaves no traceback, whatever the program is doing."""
    chance = random.Random(busy)
    command = program(tmp_path, caught(BUSY[busy]))
    for _ in range(examples(STARTS)):
        async with running(tmp_path, *command) as one:
            await one.line("^up$")
            await asyncio.sleep(chance.uniform(0, 0.1))  # for a random moment, not to wait for an event
            one.process.send_signal(signal.SIGINT)
            assert await one.end() == 0, one.lines[-30:]
        lines = [line for line in one.lines if not NOISE.search(line)]
        assert [line.rpartition(": ")[2] for line in lines] == [
            "up",
            "caught",
            "Context must be initialized before it can be shutdown",
        ], lines


@pytest.mark.parametrize("busy", ["publishing", "in callbacks", "making things", "calling", "many threads"])
@on_one_loop
async def test_ctrl_c_again_and_again(tmp_path: Path, busy: str) -> None:
    """Repeated Ctrl-C causes no output and lets no program hang."""
    chance = random.Random(busy)
    command = program(tmp_path, BEGIN + UP + BUSY[busy])
    for _ in range(examples(STARTS)):
        async with running(tmp_path, *command) as one:
            await one.line("^up$")
            while one.process.returncode is None:
                one.process.send_signal(signal.SIGINT)
                await asyncio.sleep(chance.choice([0, 0.001, 0.01, 0.05]))
            code = await one.end()
        assert [line for line in one.lines if not NOISE.search(line)] == ["up"]
        assert code == -signal.SIGINT


@on_one_loop
async def test_ctrl_c_while_a_program_starts(tmp_path: Path) -> None:
    chance = random.Random(1)
    begin = BEGIN.replace("rclpy.init()", "print('begun', flush=True)\nrclpy.init()")
    command = program(tmp_path, f"{begin}{UP}rclpy.spin(node)\n")
    for _ in range(examples(2 * STARTS)):
        async with running(tmp_path, *command) as one:
            await one.line("^begun$")
            await asyncio.sleep(chance.uniform(0, 0.4))
            one.process.send_signal(signal.SIGINT)
            code = await one.end()
        assert code == -signal.SIGINT, one.lines
        assert one.lines in (["begun"], ["begun", "up"])

"""The examples, run as their users run them."""

import asyncio
import os
import re
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from importlib import import_module
from pathlib import Path
from time import time_ns
from typing import Any
from uuid import uuid4

import pytest

import bus
from bus.msg.geometry_msgs import Twist, Vector3
from bus.msg.std_msgs import String

EXAMPLES = Path(__file__).parents[2] / "examples"
ROBOT = EXAMPLES / "robot"
LAYERS = ("perception", "cognition", "actuation", "monitoring")
LIMIT_S = 120.0
pytestmark = pytest.mark.asyncio(loop_factories=["uvloop"])  # the programs choose their own
PUBLISHED = re.compile(r'\[INFO\] \[\d{10}\.\d{9}\] \[minimal_publisher\]: Publishing: "Hello World: (\d+)"')
HEARD = re.compile(r'\[INFO\] \[\d{10}\.\d{9}\] \[(listener_[12])\]: I heard: "Hello World: (\d+)"')


class Program:
    """A running program; its lines, stdout and stderr in one, are kept as they come."""

    def __init__(self, process: asyncio.subprocess.Process, mark: str) -> None:
        self.process = process
        self._mark = f"EXAMPLE_RUN={mark}".encode()
        self.lines: list[str] = []
        self._news = asyncio.Condition()
        self._reader = asyncio.create_task(self._read())

    async def line(self, pattern: str) -> re.Match[str]:
        """The first line that `pattern` is found in."""
        async with self._news:
            while True:
                for line in self.lines:
                    if found := re.search(pattern, line):
                        return found
                assert not self._reader.done(), f"ended without {pattern!r}: {self.lines}"
                await self._news.wait()

    async def end(self) -> int:
        """Its exit status, once it has ended and everything that it said is in `lines`."""
        await self._reader
        return await self.process.wait()

    def family(self, command: str = "") -> list[int]:
        """Pids of the program and its children, those with `command` in their command line."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                is_ours = self._mark in (entry / "environ").read_bytes().split(b"\0")
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                continue  # it has ended, or is another user's
            if is_ours and command in line:
                found.append(int(entry.name))
        return found

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            async with self._news:
                self.lines.append(line.decode().rstrip("\n"))
                self._news.notify_all()
        async with self._news:
            self._news.notify_all()


@asynccontextmanager
async def running(folder: Path, *command: str | Path, **variables: str) -> AsyncIterator[Program]:
    """A Python program with its temporary files in `folder`; killed if it outlives the test."""
    mark = str(uuid4())  # in the environment of its children, too
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *command,
        env={**os.environ, "TMPDIR": str(folder), **variables, "EXAMPLE_RUN": mark},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        start_new_session=True,
    )
    program = Program(process, mark)
    try:
        async with asyncio.timeout(LIMIT_S):
            yield program
    finally:
        for pid in program.family():
            os.kill(pid, signal.SIGKILL)
        await program.end()


def assert_nothing_is_left(program: Program, folder: Path) -> None:
    assert program.family() == []
    assert list(folder.iterdir()) == []


# --- the lesson's two programs


@pytest.mark.usefixtures("daemon")
async def test_the_talker_obeys_its_arguments_and_ends_quietly(tmp_path: Path) -> None:
    rename = ("--ros-args", "-r", "__node:=other", "-r", "topic:=/somewhere/x")
    async with bus.Node("test", arguments=()) as node:
        subscription = await node.create_subscription(String, "/somewhere/x")
        async with running(tmp_path, EXAMPLES / "talker.py", *rename) as talker:
            texts = [(await subscription.receive())[0].data for _ in range(3)]
            await talker.line('Publishing: "Hello World: 2"')
            talker.process.send_signal(signal.SIGINT)
            assert await talker.end() == 0
    assert texts == ["Hello World: 0", "Hello World: 1", "Hello World: 2"]
    pattern = r'\[INFO\] \[\d{10}\.\d{9}\] \[other\]: Publishing: "Hello World: \d+"'
    assert all(re.fullmatch(pattern, line) for line in talker.lines)


@pytest.mark.usefixtures("daemon")
async def test_the_listener_warns_of_an_empty_message_and_ends_quietly(tmp_path: Path) -> None:
    rename = ("--ros-args", "-r", "__node:=other", "-r", "topic:=x")
    async with bus.Node("test", arguments=()) as node:
        publisher = await node.create_publisher(String, "x")
        async with running(tmp_path, EXAMPLES / "listener.py", *rename) as listener:
            await publisher.wait_for_subscriptions()
            publisher.publish(String())
            publisher.publish(String(data="after it"))
            await listener.line("after it")
            listener.process.send_signal(signal.SIGINT)
            assert await listener.end() == 0
    warning, info = listener.lines
    assert re.fullmatch(r"\[WARN\] \[\d{10}\.\d{9}\] \[other\]: Received empty message", warning)
    assert re.fullmatch(r'\[INFO\] \[\d{10}\.\d{9}\] \[other\]: I heard: "after it"', info)


# --- the demo


async def test_the_demo_ends_by_itself_when_both_listeners_heard_everything(tmp_path: Path) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py", "3") as demo:
        assert await demo.end() == 0, demo.lines
    *lines, verdict = demo.lines
    published: list[str] = []
    heard: dict[str, list[str]] = {"listener_1": [], "listener_2": []}
    for line in lines:
        if said := PUBLISHED.fullmatch(line):
            published.append(said[1])
        else:
            said = HEARD.fullmatch(line)
            assert said, line
            assert said[2] in published, "heard before it was published"
            heard[said[1]].append(said[2])
    assert published == [str(number) for number in range(len(published))]
    assert heard == {"listener_1": published, "listener_2": published}
    assert verdict == f"Both listeners heard all {len(published)} messages."
    assert_nothing_is_left(demo, tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
async def test_a_signal_ends_the_demo_and_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py") as demo:
        await demo.line(r"listener_1.*Hello World: 1")
        demo.process.send_signal(number)
        assert await demo.end() == 0
    assert all(PUBLISHED.fullmatch(line) or HEARD.fullmatch(line) for line in demo.lines)
    assert_nothing_is_left(demo, tmp_path)


async def test_a_demo_whose_listener_dies_fails_and_says_so(tmp_path: Path) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py", "60") as demo:
        await demo.line(r"listener_2.*Hello World: 0")
        (listener,) = demo.family("__node:=listener_2")
        os.kill(listener, signal.SIGKILL)
        assert await demo.end() == 1
    assert demo.lines[-1] == "The demo failed: listener_2 was ended by SIGKILL."
    assert_nothing_is_left(demo, tmp_path)


async def test_a_demo_too_short_for_a_message_fails(tmp_path: Path) -> None:
    async with running(tmp_path, EXAMPLES / "demo.py", "0") as demo:
        assert await demo.end() == 1
    assert demo.lines == ["The talker published nothing."]


@pytest.fixture
def examples(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """Imports a module of the examples by its name."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(ROBOT))
    yield import_module
    for name in set(sys.modules) - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(str(EXAMPLES)):
            del sys.modules[name]


@pytest.mark.parametrize(
    ("heard", "verdict"),
    [
        (["0", "1", "2"], None),
        (["0", "2"], 'listener_2 did not hear 1 of 3 messages; the first is "1".'),
        (["0", "1", "1", "2"], "listener_2 heard messages twice or out of order: ['0', '1', '1', '2']."),
    ],
)
def test_the_demo_judges_what_was_heard(
    examples: Callable[[str], Any], heard: list[str], verdict: str | None
) -> None:
    published = ["0", "1", "2"]
    texts = {"minimal_publisher": published, "listener_1": published, "listener_2": heard}
    assert examples("demo").judge(texts) == verdict


# --- the robot


async def test_the_robot_ends_by_itself_with_a_summary(tmp_path: Path) -> None:
    async with running(tmp_path, ROBOT / "main.py", "2") as robot:
        status = await robot.end()
    *_, heading, camera, imu, joints, command, applied, verdict = robot.lines
    assert heading.split() == ["topic", "due", "sent", "got"]
    for line, due in ((camera, 30), (imu, 200), (joints, 100), (command, 30), (applied, 30)):
        row = re.fullmatch(rf"/\S+ +{due} +(\d+\.\d) +(\d+\.\d)", line)
        assert row, line
        assert float(row[2]) > 0
    if status:  # the only excuse
        assert "too slow a machine, or too busy" in verdict
    else:
        assert verdict == "Every layer lived, every topic flowed."
    assert_nothing_is_left(robot, tmp_path)


async def test_ctrl_c_ends_the_robot_and_leaves_nothing(tmp_path: Path) -> None:
    async with running(tmp_path, ROBOT / "main.py") as robot:
        await robot.line(r"/imu/data +200 +[1-9]")
        robot.process.send_signal(signal.SIGINT)
        assert await robot.end() == 0
    assert all(line.startswith(("/", "topic ", "export ")) for line in robot.lines), robot.lines
    assert_nothing_is_left(robot, tmp_path)


class Observer:
    """Hears every topic of a robot, and when the only publisher of one comes and goes."""

    def __init__(self, common: Any) -> None:
        self.topics = {topic.name: topic for topic in common.TOPICS}
        health = common.Topic(common.HEALTH_TOPIC, common.Health, 1.0, bus.QoSProfile(depth=1))
        self.topics[health.name] = health
        self.subscriptions: dict[str, bus.Subscription[Any]] = {}
        self.gone = {name: asyncio.Event() for name in self.topics}

    async def subscribe(self, node: bus.Node) -> None:
        for name, topic in self.topics.items():
            gone = self.gone[name]

            def note(change: Any, gone: asyncio.Event = gone) -> None:
                gone.clear() if change.current_count else gone.set()

            self.subscriptions[name] = await node.create_subscription(
                topic.type, name, topic.qos, events=bus.SubscriptionEvents(matched=note)
            )

    async def hear(self, names: Iterable[str]) -> None:
        """Wait for a message on each topic that is published from now on."""
        now_ns = time_ns()
        for name in names:
            while (await self.subscriptions[name].receive())[1].source_timestamp <= now_ns:
                pass


PUBLISHES = {
    "perception": ("/camera/image_raw", "/imu/data", "/joint_states"),
    "cognition": ("/cmd_vel",),
    "actuation": ("/cmd_vel_applied",),
    "monitoring": ("/health",),
}
NEEDS = {"cognition": {"perception"}, "actuation": {"perception", "cognition"}}


async def test_killing_and_restarting_any_layer_leaves_the_others_running(
    tmp_path: Path, examples: Callable[[str], Any]
) -> None:
    observer = Observer(examples("common"))
    async with AsyncExitStack() as stack:
        robot = await stack.enter_async_context(running(tmp_path, ROBOT / "main.py"))
        socket = (await robot.line("export BUSD_SOCKET=(.*)"))[1]
        node = await stack.enter_async_context(bus.Node("observer", socket=socket, arguments=()))
        await observer.subscribe(node)
        await observer.hear(observer.topics)
        for layer in LAYERS:
            pids = {one.name: one.pid for one in (await node.graph()).nodes}
            os.kill(pids[layer], signal.SIGKILL)
            await observer.gone[PUBLISHES[layer][0]].wait()
            await robot.line(f"{layer} was ended by SIGKILL; the others go on")
            fed = [one for one in LAYERS if one != layer and layer not in NEEDS.get(one, ())]
            await observer.hear(topic for one in fed for topic in PUBLISHES[one])
            script = running(tmp_path, ROBOT / f"{layer}.py", BUSD_SOCKET=socket)
            await stack.enter_async_context(script)
            await observer.hear(observer.topics)
            after = {one.name: one.pid for one in (await node.graph()).nodes}
            assert {name for name in pids if after[name] != pids[name]} == {layer}


async def test_killing_and_restarting_busd_leaves_the_layers_running(
    tmp_path: Path, examples: Callable[[str], Any]
) -> None:
    observer = Observer(examples("common"))
    async with AsyncExitStack() as stack:
        robot = await stack.enter_async_context(running(tmp_path, ROBOT / "main.py"))
        socket = (await robot.line("export BUSD_SOCKET=(.*)"))[1]
        node = await stack.enter_async_context(bus.Node("observer", socket=socket, arguments=()))
        await observer.subscribe(node)
        await observer.hear(observer.topics)
        before = await node.graph()
        os.kill(before.broker_pid, signal.SIGKILL)
        await robot.line("busd was ended by SIGKILL; the others go on")
        await stack.enter_async_context(running(tmp_path, "-m", "busd", BUSD_SOCKET=socket))
        await observer.hear(observer.topics)
        after = await node.graph()
        assert after.broker_pid != before.broker_pid
        assert {one.pid for one in after.nodes} == {one.pid for one in before.nodes}


REFUSED = {
    "angular.z is 9, allowed is -2 to 2": Twist(angular=Vector3(z=9.0)),
    "linear.x is nan, allowed is -0.5 to 1": Twist(linear=Vector3(x=float("nan"))),
    "linear.y is -0.1, allowed is 0 to 0": Twist(linear=Vector3(x=0.5, y=-0.1)),
}


@pytest.mark.usefixtures("daemon")
async def test_actuation_refuses_what_is_out_of_bounds_and_stops_without_commands(tmp_path: Path) -> None:
    good = Twist(linear=Vector3(x=0.5), angular=Vector3(z=-2.0))
    async with bus.Node("test", arguments=()) as node:
        applied = await node.create_subscription(Twist, "/cmd_vel_applied")
        commands = await node.create_publisher(Twist, "/cmd_vel")
        async with running(tmp_path, ROBOT / "actuation.py") as actuation:
            await commands.wait_for_subscriptions()
            for reason, command in REFUSED.items():
                commands.publish(command)
                await actuation.line(rf"\[WARN\] .* \[actuation\]: refused a command: {reason}$")
            commands.publish(good)
            assert [(await applied.receive())[0] for _ in range(2)] == [good, Twist()]
            await actuation.line(r"\[WARN\] .* \[actuation\]: no command for 0.5 s: stopped$")
            actuation.process.send_signal(signal.SIGTERM)
            assert await actuation.end() == 0

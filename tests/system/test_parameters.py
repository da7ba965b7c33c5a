"""Parameters of a `bus.Node`, from end to end: command line, `bus param`, programs of rclpy, events, time."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.qos import parameter_events
from bus.types.classes import message_class, service_class
from cli import Running, script
from cli import bus as cli
from conftest import WAIT_S, Daemon
from neighbours import with_limits
from programs import on_one_loop
from semantics import node, until

__all__ = ["node"]

Event: Any = message_class("rcl_interfaces/msg/ParameterEvent")
Clock: Any = message_class("rosgraph_msgs/msg/Clock")
Time: Any = message_class("builtin_interfaces/msg/Time")

NATIVE = """
import asyncio, bus
async def main():
    async with bus.Node("one") as node:
        await node.declare_parameter("speed", 42, range=(0, 100, 2), description="how fast")
        await node.declare_parameter("ratio", 1.5, range=(0.5, 2.5))
        await node.declare_parameter("arm.name", "left", additional_constraints="left or right")
        await node.declare_parameter("arm.lengths", [1.0, 2.5])
        await node.declare_parameter("arm.flags", [True, False])
        await node.declare_parameter("ids", [1, 2])
        await node.declare_parameter("names", ["a", "b"])
        await node.declare_parameter("octets", b"\\x01")
        await node.declare_parameter("serial", "1e5", read_only=True)
        await node.declare_parameter("extra", 1, dynamic_typing=True)
        await node.declare_parameter("empty", type=str)
        node.on_set_parameters(lambda values: "unlucky" if values.get("speed") == 8 else None)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
RCLPY = """
import bus.rclpy_compat
import rclpy
from rclpy.node import Node
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult

rclpy.init()
node = Node("two")
node.declare_parameters("", [
    ("speed", 42, ParameterDescriptor(description="how fast", integer_range=[
        IntegerRange(from_value=0, to_value=100, step=2)])),
    ("ratio", 1.5, ParameterDescriptor(floating_point_range=[
        FloatingPointRange(from_value=0.5, to_value=2.5)])),
    ("arm.name", "left", ParameterDescriptor(additional_constraints="left or right")),
    ("arm.lengths", [1.0, 2.5]),
    ("arm.flags", [True, False]),
    ("ids", [1, 2]),
    ("names", ["a", "b"]),
    ("octets", [b"\\x01"]),
    ("serial", "1e5", ParameterDescriptor(read_only=True)),
    ("extra", 1, ParameterDescriptor(dynamic_typing=True)),
    ("empty", rclpy.Parameter.Type.STRING),
])
def check(wanted):
    is_refused = any(one.name == "speed" and one.value == 8 for one in wanted)
    return SetParametersResult(successful=not is_refused, reason="unlucky" if is_refused else "")
node.add_on_set_parameters_callback(check)
print("ready", flush=True)
rclpy.spin(node)
"""
ALL = "speed ratio arm.name arm.lengths arm.flags ids names octets serial extra empty use_sim_time"
VERBS = [
    "list NODE --param-type",
    f"describe NODE {ALL} nosuch",
    "dump NODE",
    "set NODE speed 8",
    "set NODE ratio 1",
    "set NODE nosuch 1",
    "set NODE ids []",
    "set NODE names []",
    "set NODE octets []",
    "set NODE ratio []",
    "set NODE extra text",
    "delete NODE extra",
    "load NODE FILE",
    "dump NODE",
]


def test_tools_see_both_apis_alike(daemon: object, tmp_path: Path) -> None:
    path = tmp_path / "both.yaml"
    path.write_text("/**: {ros__parameters: {speed: 50, ids: [7, 8], serial: no, arm: {name: right}}}\n")
    with script(NATIVE), script(RCLPY), ThreadPoolExecutor(2) as threads:
        for verb in VERBS:
            words = verb.replace("FILE", str(path))
            calls = [words.replace("NODE", name).split() for name in ("one", "two")]
            one, two = threads.map(lambda call: cli("param", *call), calls)
            # Nodes of rclpy have one parameter more, as in ROS 2.
            out = [line for line in two.out.splitlines(True) if "start_type_description_service" not in line]
            assert (one.out.replace("one", "two"), *one[1:]) == ("".join(out), *two[1:]), verb
        assert "speed: 50" in one.out and "name: right" in one.out and "names: []" in one.out
        assert "extra" not in one.out


def test_the_program_and_the_session_of_the_page(daemon: object, tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "parameters.md").read_text()
    source = page.partition("```python\n")[2].partition("```")[0]
    (tmp_path / "wheels.py").write_text(source)
    session = page.partition("```\n$ ")[2].partition("\n```")[0]
    commands = [one.partition("\n")[::2] for one in session.split("\n$ ")]
    (program, logged), *others = commands
    words = program.split()
    assert words[0] == "python" and len(others) == 3
    with Running(words[1:], folder=tmp_path) as running:
        assert running.error_line_with("now").split("]: ")[1] == logged.split("]: ")[1]
        for command, said in others:
            assert command.startswith("bus ")
            result = cli(*command.split()[1:])
            assert (result.out + result.err).rstrip("\n") == said


GIVEN = """
import asyncio, bus
async def main():
    async with bus.Node("wheels", namespace="/robot") as node:
        print(await node.declare_parameter("speed", 1.5), await node.declare_parameter("wheel.name", "front"),
              await node.declare_parameter("gain", 1), node.get_parameter("use_sim_time"))
bus.run(main())
"""


def test_the_command_line(daemon: object, tmp_path: Path) -> None:
    path = tmp_path / "wheels.yaml"
    path.write_text(
        "/**: {ros__parameters: {use_sim_time: true, gain: 2}}\n"
        "/robot/wheels: {ros__parameters: {speed: 3.0, wheel: {name: left}}}\n"
        "/other: {ros__parameters: {speed: 9.0}}\n"
    )
    words = ("--ros-args", "--params-file", str(path), "-p", "gain:=3", "-p", "other:gain:=4")
    with Running(("-c", GIVEN, *words)) as running:
        assert running.line() == "3.0 left 3 True"


MISTAKES = {
    "-p speed:=5": "parameter 'speed' of /robot/wheels: can't be 5, as the command line says: "
    "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.INTEGER'; write 5.0",
    "-p use_sim_time:=x": "parameter 'use_sim_time' of /robot/wheels: can't be 'x', "
    "as the command line says: Wrong parameter type, expected 'Type.BOOL' got 'Type.STRING'",
    "--params-file nosuch": "Couldn't parse params file: '--params-file nosuch'. Error: "
    "cannot read 'nosuch': No such file or directory",
    "-p speed": "Couldn't parse parameter override rule: '-p speed'. Error: expected ':=' between two names",
}


def test_mistakes_on_the_command_line_get_one_line(daemon: object) -> None:
    for words, said in MISTAKES.items():
        with Running(("-c", GIVEN, "--ros-args", *words.split())) as running:
            assert running.end() == ("", f"CommandLineError: {said}\n", 1), words


async def test_a_file_that_cannot_be_used(tmp_path: Path) -> None:
    path = tmp_path / "wheels.yaml"
    path.write_text("/wheels:\n  ros__parameters:\n    speed: {}\n    gain: [1, a]\n")
    with pytest.raises(bus.CommandLineError, match=r"wheels.yaml:4: parameter 'gain': a list must hold"):
        bus.Node("wheels", arguments=["--ros-args", "--params-file", str(path)])


PLAIN = """
import sys, bus
async def main():
    async with bus.Node("plain") as node:
        node.now()
        print(*sorted(name for name in sys.modules if name.startswith("bus.")))
bus.run(main())
"""


def test_a_node_without_parameters_imports_nothing_for_them(daemon: object) -> None:
    with Running(("-c", PLAIN), is_fresh=True) as running:
        imported = set(running.line().split())
    assert "bus.parameters.host" in imported
    assert not imported & {
        *("bus.types.classes", "bus.parameters.file", "bus.parameters.values", "bus.parameters.server"),
        *(
            "bus.parameters.store",
            "bus.parameters.parameter_set",
            "bus.service.base",
            "bus.service.server",
            "bus.parameters.time_source",
        ),
    }


async def test_busd_comes_back(node: bus.Node, daemon: Daemon) -> None:
    await node.declare_parameter("speed", 1.5)
    daemon.kill()
    node.set_parameter("speed", 2)
    daemon.restart()
    async with bus.Node("caller", arguments=[]) as caller:
        assert await set_remotely(caller, "tester", speed=2.5) == [(True, "")]
    assert node.get_parameter("speed") == 2.5


class TestServices:
    @pytest.fixture
    async def wheels(self, daemon: Daemon, route: str) -> AsyncIterator[bus.Node]:
        async with asyncio.timeout(WAIT_S), bus.Node("wheels", arguments=[]) as node:
            yield node

    async def test_a_node_without_parameters_has_none_of_it(self, wheels: bus.Node) -> None:
        wheels.on_set_parameters(lambda values: None)
        assert wheels.get_parameters() == {"use_sim_time": False}
        graph = await wheels.graph()
        assert [one.topic for one in graph.publishers if one.node.name == "wheels"] == ["/rosout"]
        assert not [one for one in graph.subscriptions if one.node.name == "wheels"]

    async def test_values_of_the_command_line_are_seen_before_they_are_declared(self, daemon: Daemon) -> None:
        async with bus.Node("wheels", arguments=["--ros-args", "-p", "speed:=1"]) as node:
            assert (await node.graph()).servers_of("/wheels/list_parameters")
        async with bus.Node("wheels", arguments=["--ros-args", "-p", "other:speed:=1"]) as node:
            assert not (await node.graph()).servers_of("/wheels/list_parameters")

    async def test_set_from_outside(self, node: bus.Node, wheels: bus.Node) -> None:
        heard: list[Any] = []
        await wheels.declare_parameter("speed", 1.5, range=(0, 10))
        await wheels.declare_parameter("name", "left")
        wheels.post_set_parameters(heard.append)
        assert await set_remotely(node, "wheels", speed=2.5) == [(True, "")]
        assert await set_remotely(node, "wheels", speed=12.5, name="right") == [
            (False, "Parameter speed out of range. Min: 0.0, Max: 10.0, value: 12.5"),
            (True, ""),
        ]
        assert heard == [{"speed": 2.5}, {"name": "right"}]
        assert wheels.get_parameters() == {"use_sim_time": False, "speed": 2.5, "name": "right"}
        kind: Any = service_class("rcl_interfaces/srv/SetParametersAtomically")
        client = await node.create_client(kind, "/wheels/set_parameters_atomically")
        wanted = [parameter("speed", 3.5), parameter("name", 1)]
        result = (await client.call(kind.Request(parameters=wanted))).result
        assert (result.successful, wheels.get_parameter("speed")) == (False, 2.5)
        wanted[1].value.type = 77
        result = (await client.call(kind.Request(parameters=wanted))).result
        assert (result.successful, result.reason) == (False, "unexpected parameter type 77")

    async def test_changes_are_told(self, node: bus.Node, wheels: bus.Node) -> None:
        events: list[Any] = []
        await node.create_subscription(Event, "/parameter_events", parameter_events, events.append)
        await wheels.declare_parameter("speed", 1.5)
        await wheels.declare_parameter("extra", 1, dynamic_typing=True)
        wheels.set_parameters({"speed": 2, "extra": "x"})
        await set_remotely(node, "wheels", extra=None)
        await until(lambda: len(events) == 4)
        parts: list[tuple[str, str, Any]] = [
            ("new", "speed", 1.5),
            ("new", "extra", 1),
            ("changed", "speed", 2.0),
            ("deleted", "extra", None),
        ]
        for event, (part, name, value) in zip(events, parts, strict=True):
            assert event.node == "/wheels"
            found = getattr(event, f"{part}_parameters")[0]
            assert (found.name, found.value) == (name, parameter("", value).value)
        assert events[0].stamp.sec > 1_600_000_000

    async def test_what_a_callback_raises(self, node: bus.Node, daemon: Daemon) -> None:
        def check(values: dict[str, Any]) -> str | None:
            return "no" if values["speed"] > 1 / values["speed"] else None

        with pytest.raises(ZeroDivisionError):
            async with bus.Node("wheels", arguments=[]) as wheels:
                await wheels.declare_parameter("speed", 0.5)
                wheels.on_set_parameters(check)
                with pytest.raises(bus.ParameterError, match=r"can't be 2\.0: no"):
                    wheels.set_parameter("speed", 2)
                with pytest.raises(bus.ServiceError, match="ZeroDivisionError"):
                    await set_remotely(node, "wheels", speed=0.0)
                await wheels.spin()

    async def test_declarations_at_once(self, wheels: bus.Node) -> None:
        hurried = asyncio.create_task(wheels.declare_parameter("never", 1))
        await asyncio.sleep(0)
        hurried.cancel()
        names = [f"p{number}" for number in range(5)]
        assert await asyncio.gather(*(wheels.declare_parameter(name, 1) for name in names)) == [1] * 5
        assert not wheels.has_parameter("never")
        servers = (await wheels.graph()).servers_of("/wheels/list_parameters")
        assert len(servers) == 1

    async def test_closed_meanwhile(self, wheels: bus.Node) -> None:
        declaring = asyncio.create_task(wheels.declare_parameter("speed", 1.5))
        await asyncio.sleep(0)
        await wheels.close()
        with pytest.raises(bus.ConnectionClosed, match="node /wheels is closed"):
            await declaring

    async def test_a_node_that_is_not_open(self, wheels: bus.Node) -> None:
        await wheels.declare_parameter("speed", 1.5)
        await wheels.close()
        wheels.set_parameter("speed", 2)
        assert wheels.get_parameter("speed") == 2.0
        with pytest.raises(bus.ConnectionClosed):
            await wheels.declare_parameter("other", 1)
        with pytest.raises(bus.ConnectionClosed):
            wheels.create_rate(1.0)

    @with_limits(message_bytes=100_000)
    async def test_what_would_be_too_much_to_say_harms_nobody(
        self, node: bus.Node, wheels: bus.Node, caplog: pytest.LogCaptureFixture
    ) -> None:
        kind: Any = service_class("rcl_interfaces/srv/GetParameters")
        await wheels.declare_parameter("name", "x" * 60_000)
        client = await node.create_client(kind, "wheels/get_parameters")
        for _ in range(2):
            with pytest.raises(bus.ServiceError, match=r"PayloadTooLarge: .*the limit is 100000"):
                await client.call(kind.Request(names=["name"] * 2))
        wheels.set_parameter("name", "x" * 100_000)
        assert "a change of parameters is told to nobody: message on '/parameter_events' has" in caplog.text
        assert "no answer of service '/wheels/get_parameters' to one request: message on" in caplog.text
        assert await set_remotely(node, "wheels", name="left") == [(True, "")]
        assert wheels.get_parameter("name") == "left"

    async def test_opened_again(self, node: bus.Node, wheels: bus.Node) -> None:
        await wheels.declare_parameter("speed", 1.5)
        await wheels.close()
        await wheels.open()
        assert await set_remotely(node, "wheels", speed=2.5) == [(True, "")]
        await wheels.declare_parameter("gain", 1)
        assert await set_remotely(node, "wheels", gain=2) == [(True, "")]


# Sets a parameter of the native node, and waits until the native node has set one of the client's.
CLIENT = """
import bus.rclpy_compat
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

rclpy.init()
node = Node("client")
node.declare_parameter("answer", 0)
client = AsyncParameterClient(node, "tester")
client.wait_for_services()
def ask(future):
    rclpy.spin_until_future_complete(node, future)
    return future.result()
for value in (2.5, 99.0):
    done = ask(client.set_parameters([Parameter("speed", value=value)])).results[0]
    print(done.successful, done.reason, flush=True)
print(ask(client.get_parameters(["speed"])).values[0].double_value, flush=True)
while node.get_parameter("answer").value == 0:
    rclpy.spin_once(node)
print("answer", node.get_parameter("answer").value, flush=True)
"""


@on_one_loop
async def test_a_program_of_rclpy_sets_it_and_is_set(node: bus.Node, tmp_path: Path) -> None:
    await node.declare_parameter("speed", 1.5, range=(0, 10))
    with Running(("-c", CLIENT)) as client:
        assert await asyncio.to_thread(client.line) == "True "
        assert await asyncio.to_thread(client.line) == (
            "False Parameter speed out of range. Min: 0.0, Max: 10.0, value: 99.0"
        )
        assert await asyncio.to_thread(client.line) == "2.5"
        assert node.get_parameter("speed") == 2.5
        assert await set_remotely(node, "client", answer=42) == [(True, "")]
        assert await asyncio.to_thread(client.line) == "answer 42"


class TestSimulatedTime:
    async def test_now_is_the_machines_time(self, node: bus.Node) -> None:
        first, second = node.now(), node.now()
        assert 1_600_000_000 < first.sec <= second.sec

    async def test_the_clock_and_rates_follow(self, node: bus.Node, route: str) -> None:
        async with bus.Node("robot", arguments=["--ros-args", "-p", "use_sim_time:=true"]) as robot:
            assert (robot.now().sec, robot.now().nanosec) == (0, 0)
            publisher = await node.create_publisher(Clock, "/clock", 1)

            async def at(sec: int, nanosec: int = 0) -> None:
                publisher.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
                await until(lambda: (robot.now().sec, robot.now().nanosec) == (sec, nanosec))

            await at(100)
            rate = robot.create_rate(2.0)
            ticks: list[float] = []
            robot.create_timer(0.5, lambda: ticks.append(robot.now().nanosec))
            sleeping = asyncio.create_task(rate.sleep())
            await at(100, 499_999_999)
            assert not sleeping.done()
            assert not ticks
            await at(100, 500_000_000)
            await sleeping
            assert ticks == [500_000_000]
            assert await set_remotely(node, "robot", use_sim_time=False) == [(True, "")]
            assert robot.now().sec > 1_600_000_000
            await rate.sleep()
            await until(lambda: publisher.statistics().subscriptions == 0)

    async def test_a_program_turns_it_on(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Clock, "/clock", 1)
        assert await node.declare_parameter("use_sim_time", True) is True
        publisher.publish(Clock(clock=Time(sec=5)))
        await until(lambda: node.now().sec == 5)
        publisher.publish(Clock(clock=Time(sec=-5)))
        publisher.publish(Clock(clock=Time(sec=6)))
        await until(lambda: node.now().sec == 6)
        node.set_parameter("use_sim_time", False)
        assert node.now().sec > 1_600_000_000
        node.set_parameter("use_sim_time", True)
        await until(lambda: publisher.statistics().subscriptions == 1)

    async def test_a_node_that_is_opened_again(self, node: bus.Node, daemon: Daemon) -> None:
        publisher = await node.create_publisher(Clock, "/clock", 1)
        robot = bus.Node("robot", arguments=[])
        robot.set_parameter("use_sim_time", True)
        for sec in (5, 6):
            async with robot:
                rate = robot.create_rate(1.0)
                publisher.publish(Clock(clock=Time(sec=sec)))
                await until(lambda sec=sec: robot.now().sec == sec)  # type: ignore[misc]
            with pytest.raises(bus.ConnectionClosed):
                await rate.sleep()
        robot.undeclare_parameter("use_sim_time")
        async with robot:
            assert robot.now().sec > 1_600_000_000
            await robot.declare_parameter("use_sim_time", "maybe")
            assert robot.now().sec > 1_600_000_000

    async def test_without_a_declaration(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Clock, "/clock", 1)
        node.set_parameter("use_sim_time", True)
        await until(lambda: publisher.statistics().subscriptions == 1)
        publisher.publish(Clock(clock=Time(sec=5)))
        await until(lambda: node.now().sec == 5)


def parameter(name: str, value: Any) -> Any:
    """A rcl_interfaces/msg/Parameter."""
    fields = {bool: (1, "bool"), int: (2, "integer"), float: (3, "double"), str: (4, "string")}
    make: Any = message_class("rcl_interfaces/msg/ParameterValue")
    if value is None:
        found = make()
    else:
        number, field = fields[type(value)]
        found = make(type=number, **{f"{field}_value": value})
    owner: Any = message_class("rcl_interfaces/msg/Parameter")
    return owner(name=name, value=found)


async def set_remotely(node: bus.Node, owner: str, /, **values: Any) -> list[tuple[bool, str]]:
    """Sets parameters of the named node, one by one; the results."""
    kind: Any = service_class("rcl_interfaces/srv/SetParameters")
    client = await node.create_client(kind, f"/{owner}/set_parameters")
    await client.wait_for_service()
    response = await client.call(kind.Request(parameters=[parameter(*one) for one in values.items()]))
    await client.close()
    return [(one.successful, one.reason) for one in response.results]

"""Services and actions between a bus and ROS 2's rclpy, through `bus bridge ros2`."""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest

import bus
import bus_actions
from bridged_world import World, on_one_loop, until
from bus.errors import ServiceUnavailable
from bus.types.classes import service_class
from peers import peer
from peers.peer import Peer
from ros2_bridged import LIST, ask, join, ros, world

__all__ = ["world"]

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

GET = "rcl_interfaces/srv/GetParameters"
SET = "rcl_interfaces/srv/SetParameters"
FIBONACCI = "test_msgs/action/Fibonacci"
SHARE = Path(__file__).parents[1] / "differential/share"
SUCCEEDED, CANCELED = 4, 5
ListParameters: Any = service_class(LIST)
CARRIERS = pytest.mark.parametrize("carrier", ["cyclonedds", pytest.param("rtps", marks=pytest.mark.nightly)])
"""Feedback and status of actions are topics, so they go by the carrier of topics."""


async def services_of(far: Peer, *names: str) -> dict[str, list[str]]:
    """The services of our node as `far` sees them, once these are there."""
    await asyncio.to_thread(far.wait_for, "nodes", lambda found: "/robot" in found)
    found: dict[str, list[str]] = await asyncio.to_thread(
        far.wait_for, "services", lambda found: {*names} <= found.keys(), name="robot"
    )
    return found


def answer(request: Any) -> Any:
    response = ListParameters.Response()
    response.result.names = [*request.prefixes, str(request.depth)]
    return response


@peer.each_distro
@on_one_loop
async def test_rclpy_calls_a_server_of_the_bus(world: World, distro: peer.Distro) -> None:
    side, bridge = join(world)

    def on_request(request: Any, request_id: bus.RequestId) -> None:
        server.respond(request_id, answer(request), "" if request.depth != 13 else "no thirteen")

    async with side.node("server") as node:
        server = await node.create_service(ListParameters, "/ours", on_request=on_request)
        with await ros(world, distro) as far:
            call = {"service": "/ours", "type_name": LIST, "prefixes": ["grüß"], "depth": 5}
            (first,) = await ask(far, "call", **call)
            assert first["result"]["names"] == ["grüß", "5"]
            for _ in range(10):  # ten at once: between nodes of ROS 2, answers to more of them are lost
                assert await ask(far, "call", **call, count=10) == 10 * [first]
            assert server.statistics().requests == 101
            assert await ask(far, "call", **{**call, "depth": 13}, time_s=0.5) == [None]
            assert "no thirteen" in bridge.log.read_text()


@peer.each_distro
@on_one_loop
async def test_the_bus_calls_a_server_of_rclpy(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    async with side.node("client") as node:
        client = await node.create_client(ListParameters, "/theirs")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, result={"names": ["a"]})
            await client.wait_for_service()
            for _ in range(5):
                calls = [client.call(ListParameters.Request(depth=number)) for number in range(100)]
                found = await asyncio.gather(*calls)
                assert [one.result.names for one in found] == 100 * [["a"]]
            heard = await asyncio.to_thread(far.wait, "/theirs", 500)
            assert sorted(one["depth"] for one in heard) == sorted(5 * [*range(100)])
            await ask(far, "offer", service="/slow", type_name=LIST, pause_s=100.0)
            slow = await node.create_client(ListParameters, "/slow")
            await slow.wait_for_service()
            task = asyncio.create_task(slow.call(ListParameters.Request()))
            await asyncio.to_thread(far.wait, "/slow")
            await ask(far, "end", topic="/slow")
            with pytest.raises((ServiceUnavailable, bus.ServiceError)):
                await task
            far.kill()


@peer.each_distro
@on_one_loop
async def test_rclpy_sets_parameters_of_a_node_of_the_bus(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    async with side.node("robot") as node:
        await node.declare_parameter("speed", 3)
        with await ros(world, distro) as far:
            (found,) = await ask(far, "call", service="/robot/list_parameters", type_name=LIST)
            assert "speed" in found["result"]["names"]
            change = {"name": "speed", "value": {"type": 2, "integer_value": 9}}
            (found,) = await ask(
                far, "call", service="/robot/set_parameters", type_name=SET, parameters=[change]
            )
            assert [one["successful"] for one in found["results"]] == [True]
            (found,) = await ask(
                far, "call", service="/robot/get_parameters", type_name=GET, names=["speed", "use_sim_time"]
            )
            assert [(one["type"], one["integer_value"]) for one in found["values"]] == [(2, 9), (1, 0)]
        assert node.get_parameter("speed") == 9


@peer.each_distro
@on_one_loop
async def test_the_bus_sets_parameters_of_a_node_of_rclpy(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    with await ros(world, distro):
        await until(lambda: side.bus("param", "get", "/ros_node", "use_sim_time").code == 0)
        assert side.bus("param", "get", "/ros_node", "use_sim_time").out == "Boolean value is: False\n"
        assert side.bus("param", "set", "/ros_node", "use_sim_time", "true").code == 0
        assert side.bus("param", "get", "/ros_node", "use_sim_time").out == "Boolean value is: True\n"
        assert "use_sim_time" in side.bus("param", "list", "/ros_node").out


@peer.each_distro
@on_one_loop
async def test_rules_forbid_parameters(world: World, distro: peer.Distro, tmp_path: Path) -> None:
    config = tmp_path / "rules.toml"
    config.write_text('[[bridge.ros2.topics]]\npattern = "/**"\nkind = "parameters"\ndirection = "in"\n')
    side, _ = join(world, "--config", str(config))
    async with side.node("robot") as node:
        await node.declare_parameter("speed", 3)
        await node.create_service(ListParameters, "/ours", answer)
        with await ros(world, distro) as far:
            found = await services_of(far, "/ours")
            assert "/robot/set_parameters" not in found
            await until(lambda: side.bus("param", "get", "/ros_node", "use_sim_time").code == 0)


@peer.each_distro
@on_one_loop
async def test_each_side_lists_the_services_of_the_other(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    async with side.node("robot") as node:
        await node.declare_parameter("speed", 3)
        await node.create_service(ListParameters, "/ours", answer)
        await node.create_client(ListParameters, "/asked")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST)
            await until(lambda: "/theirs" in side.bus("service", "list").out)
            assert side.bus("service", "type", "/theirs").out == f"{LIST}\n"
            await until(lambda: "/theirs" in side.bus("node", "info", "/ros_node").out)
            found = await services_of(far, "/ours", "/robot/get_parameters")
            assert found["/ours"] == [LIST] and found["/robot/get_parameters"] == [GET]
            assert (await ask(far, "services"))["/ours"] == [LIST]
            assert await ask(far, "nodes") == ["/robot", "/ros_node"]  # each once


@pytest.fixture
def test_msgs(distro: peer.Distro, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The type of the actions: the only one that has a package for rclpy."""
    if reason := peer.why_no_ros(distro, "test_msgs"):
        pytest.skip(reason)
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(SHARE))
    return bus_actions.find_action(FIBONACCI)


@CARRIERS
@peer.each_distro
@on_one_loop
async def test_rclpy_sends_goals_to_an_action_of_the_bus(
    world: World, distro: peer.Distro, carrier: str, test_msgs: Any
) -> None:
    world.carrier = carrier
    side, _ = join(world)
    gate = asyncio.Event()

    async def execute(goal: Any) -> Any:
        # Feedback has no late joiners: the client's subscription may come after its goal.
        await node.wait_for_graph(lambda graph: bool(graph.subscriptions_of("/count/_action/feedback")))
        for number in range(3):
            yield test_msgs.Feedback(sequence=[number])
        if goal.request.order == 13:
            await gate.wait()
        yield test_msgs.Result(sequence=[*range(goal.request.order)])

    async with side.node("robot") as node, bus_actions.ActionServer(node, test_msgs, "/count", execute):
        with await ros(world, distro) as far:
            goal = {"action": "/count", "type_name": FIBONACCI}
            status, result, feedbacks = await ask(far, "send_goal", **goal, order=5)
            assert (status, result) == (SUCCEEDED, {"sequence": [0, 1, 2, 3, 4]})
            assert feedbacks == [{"sequence": [number]} for number in range(3)]
            status, _, _ = await ask(far, "send_goal", **goal, order=13, cancel_after=2)
            assert status == CANCELED


@CARRIERS
@peer.each_distro
@on_one_loop
async def test_the_bus_sends_goals_to_an_action_of_rclpy(
    world: World, distro: peer.Distro, carrier: str, test_msgs: Any
) -> None:
    world.carrier = carrier
    side, _ = join(world)
    with await ros(world, distro) as far:
        await ask(far, "serve_action", action="/count", type_name=FIBONACCI)
        await ask(far, "serve_action", action="/long", type_name=FIBONACCI, feedbacks=1000, pause_s=0.02)
        async with (
            side.node("robot") as node,
            bus_actions.ActionClient(node, test_msgs, "/count") as client,
            bus_actions.ActionClient(node, test_msgs, "/long") as long,
        ):
            await client.wait_for_server()
            goal = await client.send_goal(test_msgs.Goal(order=4))
            assert [one.sequence async for one in goal] == [[0], [1]]
            assert (await goal.result()).sequence == [0, 1, 2, 3]
            await long.wait_for_server()
            goal = await long.send_goal(test_msgs.Goal(order=4))
            async for _ in goal:
                break
            await goal.cancel()
            with pytest.raises(bus_actions.GoalCanceled):
                await goal.result()


NESTED = "test_msgs/action/NestedMessage"
FIELDS = {
    "nested_field_no_pkg": {
        "duration_value": {"sec": -1, "nanosec": 2},
        "time_value": {"sec": 3, "nanosec": 4},
    },
    "nested_field": {"bool_value": True, "int64_value": -(1 << 60), "float64_value": 0.1, "uint8_value": 255},
    "nested_different_pkg": {"sec": 5, "nanosec": 6},
}
"""Fields of a goal, of feedback and of a result: messages of two packages, as in Nav2's NavigateToPose."""


def fill(message: Any, values: dict[str, Any] = FIELDS) -> Any:
    """`message`, with these values."""
    for name, value in values.items():
        setattr(message, name, fill(getattr(message, name), value) if isinstance(value, dict) else value)
    return message


def some_of(message: Any, wanted: Any = FIELDS) -> Any:
    """The wanted fields of a message, or of one as values."""
    if not isinstance(wanted, dict):
        return message
    fields = message if isinstance(message, dict) else {name: getattr(message, name) for name in wanted}
    return {name: some_of(fields[name], value) for name, value in wanted.items()}


@peer.each_distro
@on_one_loop
async def test_actions_whose_fields_are_messages(world: World, distro: peer.Distro, test_msgs: Any) -> None:
    """Both ways at once."""
    side, _ = join(world)
    nested = bus_actions.find_action(NESTED)

    async def execute(goal: Any) -> Any:
        await node.wait_for_graph(lambda graph: bool(graph.subscriptions_of("/ours/_action/feedback")))
        values = some_of(goal.request)
        yield fill(nested.Feedback(), values)
        yield fill(nested.Result(), values)

    async with (
        side.node("robot") as node,
        bus_actions.ActionServer(node, nested, "/ours", execute),
        bus_actions.ActionClient(node, nested, "/theirs") as client,
    ):
        with await ros(world, distro) as far:
            await ask(far, "echo_action", action="/theirs", type_name=NESTED)
            status, result, feedbacks = await ask(
                far, "send_goal", action="/ours", type_name=NESTED, **FIELDS
            )
            assert (status, some_of(result), [*map(some_of, feedbacks)]) == (SUCCEEDED, FIELDS, [FIELDS])
            await client.wait_for_server()
            goal = await client.send_goal(fill(nested.Goal()))
            assert [some_of(one) async for one in goal] == [FIELDS]
            assert some_of(await goal.result()) == FIELDS


@peer.each_distro
@on_one_loop
async def test_the_verbs_of_bus_reach_a_node_of_rclpy(
    world: World, distro: peer.Distro, tmp_path: Path, test_msgs: Any
) -> None:
    side, _ = join(world)
    with await ros(world, distro) as far:
        await ask(far, "offer", service="/theirs", type_name=LIST, result={"names": ["a"]})
        await ask(far, "serve_action", action="/long", type_name=FIBONACCI, feedbacks=1000, pause_s=0.02)
        await ask(far, "serve_action", action="/count", type_name=FIBONACCI)
        await until(lambda: side.bus("service", "info", "/theirs").out.endswith("Services count: 1\n"))
        assert "names=['a']" in side.bus("service", "call", "/theirs", LIST, "{depth: 3}").out
        await until(lambda: [one["depth"] for one in far.heard["/theirs"]] == [3])
        await until(lambda: side.bus("action", "list").out == "/count\n/long\n")
        assert "/ros_node_actions" in side.bus("action", "info", "/count").out

        goal = side.bus("action", "send_goal", "/count", FIBONACCI, "{order: 3}", "--feedback", "--json")
        assert goal.out.splitlines()[1:] == [
            '{"feedback":{"sequence":[0]}}',
            '{"feedback":{"sequence":[1]}}',
            '{"result":{"sequence":[0,1,2]},"status":"SUCCEEDED"}',
        ]
        with side.start("action", "send_goal", "/long", FIBONACCI, "{order: 3}", "--feedback") as sending:
            sending.line_with("Feedback:")
            sending.process.send_signal(signal.SIGINT)
            sending.line_with("Goal canceled.")

        await until(lambda: side.bus("param", "dump", "/ros_node").code == 0)
        dumped = side.bus("param", "dump", "/ros_node").out
        assert "use_sim_time: false" in dumped
        file = tmp_path / "ros_node.yaml"
        file.write_text("/ros_node: {ros__parameters: {use_sim_time: true}}\n")
        loaded = side.bus("param", "load", "/ros_node", str(file))
        assert loaded.out == "Set parameter use_sim_time successful\n"
        assert side.bus("param", "get", "/ros_node", "use_sim_time").out == "Boolean value is: True\n"

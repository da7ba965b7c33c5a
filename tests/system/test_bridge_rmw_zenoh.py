"""`bus bridge ros2 --rmw zenoh`, and a node as rmw_zenoh makes it, through a router of zenoh."""

import asyncio
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec
import pytest

import bus
import bus_actions
from bridged_world import on_one_loop, until
from bus.errors import ServiceUnavailable
from bus.msg.std_msgs import String
from bus.srv.std_srvs import SetBool
from bus.types.classes import service_class
from rmw_zenoh_bridged import Ros, ask, kind_of, message_codec, ros, service_codecs, service_kind

__all__ = ["ros"]

Way = Literal["--connect", "--router"]
WAYS = pytest.mark.parametrize("by", get_args(Way))
ONE_WAY = pytest.mark.parametrize("by", ["--router", pytest.param("--connect", marks=pytest.mark.nightly)])
"""For all but the messages of a publisher, and what comes back: there the ways are tried daily."""
STRING = kind_of("std_msgs/msg/String")
SET_BOOL = service_kind("std_srvs/srv/SetBool")
LIST = "rcl_interfaces/srv/ListParameters"
FIBONACCI = "test_msgs/action/Fibonacci"
SHARE = Path(__file__).parents[1] / "differential/share"
_TEXT = message_codec("std_msgs/msg/String")
_ASK, _ANSWER = service_codecs("std_srvs/srv/SetBool")
GOAL = bytes(range(16))


def cdr(codec: Any, *fields: Any) -> str:
    return b"".join(codec.encode(msgspec.msgpack.encode(fields))).hex()


def fields(codec: Any, text: str) -> Any:
    return msgspec.msgpack.decode(codec.decode(bytes.fromhex(text)))


def text(data: str) -> str:
    return cdr(_TEXT, data)


@on_one_loop
async def test_a_publisher_of_ros_2_is_heard(ros: Ros) -> None:
    ros.bridge()
    heard: list[tuple[str, bus.MessageInfo]] = []
    with ros.peer() as far:
        async with ros.side.node("listener") as node:
            await node.create_subscription(
                String, "/chatter", 100, lambda message, info: heard.append((message.data, info))
            )
            await until(lambda: any("MS" in key for key in far.ask("tokens")))
            # At once after its token: messages wait for their route.
            gid = await ask(far, "publish", topic="/chatter", **STRING)
            await ask(far, "send", topic="/chatter", messages=[text(str(one)) for one in range(50)])
            await until(lambda: len(heard) == 50)
            assert [data for data, _ in heard] == [str(one) for one in range(50)]
            assert heard[0][1].publisher_gid.hex() == gid
            graph = ros.side.graph()
            (publisher,) = graph.publishers_of("/chatter")
            assert publisher.qos == bus.QoSProfile(10)
            assert "/far" in {one.full_name for one in graph.nodes}
            await ask(far, "end", name="/chatter")
            await ros.side.shows(lambda graph: not graph.publishers_of("/chatter"))


@on_one_loop
async def test_missing_numbers_are_losses(ros: Ros) -> None:
    bridge = ros.bridge()
    heard: list[str] = []
    with ros.peer() as far:
        async with ros.side.node("listener") as node:
            await node.create_subscription(String, "/chatter", 100, lambda one: heard.append(one.data))
            await ask(far, "publish", topic="/chatter", **STRING)
            await until(lambda: any("MS" in key for key in far.ask("tokens")))
            await ask(far, "send", topic="/chatter", messages=[text("a"), text("b")])
            await ask(far, "send", topic="/chatter", messages=[text("c"), "0001000000ff"], skip=3)
            await ask(far, "send", topic="/chatter", messages=[text("x")], attachment="00")
            await ask(far, "send", topic="/chatter", messages=[text("d")])
            await until(lambda: heard[-1:] == ["d"])
            route = bridge.route("/chatter", "in")
    assert heard == ["a", "b", "c", "d"]
    # Lost: 3 numbers, and that of a message without an attachment.
    assert route["dropped"] == {"lost_on_the_way": 4, "undecodable": 1}
    assert "they have no attachment of ROS 2's rmw_zenoh" in bridge.log.read_text()


@on_one_loop
async def test_a_bus_may_have_a_bridge_to_each_middleware(ros: Ros) -> None:
    bridge = ros.bridge()
    other = ros.side.bridge("ros2", "--id", "robot", "--carrier", "rtps", "--domain-id", str(ros.domain))
    heard: list[str] = []
    with ros.peer() as far:
        async with ros.side.node("node") as node:
            await node.create_subscription(String, "/theirs", 100, lambda one: heard.append(one.data))
            publisher = await node.create_publisher(String, "/ours", 100)
            await ask(far, "publish", topic="/theirs", **STRING)
            await ask(far, "listen", topic="/ours", **STRING)
            await publisher.wait_for_subscriptions()
            publisher.publish(String(data="there"))
            await until(lambda: any("MS" in key and "theirs" in key for key in far.ask("tokens")))
            await ask(far, "send", topic="/theirs", messages=[text("here")])
            await until(lambda: heard)
            found = [one["cdr"] for one in await asyncio.to_thread(far.wait, "/ours", 1)]
            await until(lambda: f"in ROS 2's domain {ros.domain} on DDS" in other.log.read_text())
            buses = [{link["bus"] for link in one.status()["links"]} for one in (bridge, other)]
    assert buses == [{"", f"rmw_zenoh{ros.domain}"}, {f"dds{ros.domain}"}]
    assert (heard, found) == (["here"], [text("there")])


@WAYS
@on_one_loop
async def test_a_publisher_of_the_bus_is_heard(ros: Ros, by: Way) -> None:
    ros.bridge(by=by)
    with ros.peer() as far:
        async with ros.side.node("talker", namespace="/ns") as node:
            publisher = await node.create_publisher(String, "/chatter", 1000)
            await ask(far, "listen", topic="/chatter", **STRING)
            await publisher.wait_for_subscriptions()
            for number in range(300):
                publisher.publish(String(data=str(number)))
            found = await asyncio.to_thread(far.wait, "/chatter", 300)
            assert [one["cdr"] for one in found] == [text(str(number)) for number in range(300)]
            assert [one["number"] for one in found] == [*range(1, 301)]
            (token,) = (key for key in await ask(far, "tokens") if "/MP/%busd%robot/%ns/talker/" in key)
            assert token.endswith(
                f"/%chatter/std_msgs::msg::dds_::String_/{STRING['type_hash']}/::,1000:,:,:,,"
            )
            assert {one["gid"] for one in found} == {(await ask(far, "tokens"))[token]}
            assert all(far.source_times_ns["/chatter"])
        await until(lambda: not [one for one in far.ask("tokens") if "talker" in one])


@ONE_WAY
@on_one_loop
async def test_late_joiners_get_the_history_in_both_directions(ros: Ros, by: Way) -> None:
    ros.bridge(by=by)
    latched = bus.QoSProfile(3, durability="transient_local")
    heard: list[list[str]] = [[], []]
    with ros.peer() as far:
        async with ros.side.node("node") as node:
            await ask(far, "publish", topic="/theirs", kept=3, **STRING)
            await ask(far, "send", topic="/theirs", messages=[text(one) for one in "abcde"])
            await ros.side.shows(lambda graph: graph.publishers_of("/theirs"))
            for to in heard:
                await node.create_subscription(
                    String, "/theirs", latched, lambda one, to=to: to.append(one.data)
                )
                await until(lambda to=to: to == ["c", "d", "e"], lambda: str(heard))
            await ask(far, "send", topic="/theirs", messages=[text("f")])
            await until(lambda: heard == 2 * [["c", "d", "e", "f"]], lambda: str(heard))
            publisher = await node.create_publisher(String, "/ours", latched)
            for letter in "abcde":
                publisher.publish(String(data=letter))
            await until(lambda: any("%ours" in key for key in far.ask("tokens")))
            await ask(far, "listen", topic="/ours", history=True, **STRING)
            found = await asyncio.to_thread(far.wait, "/ours", 3)
            assert [one["cdr"] for one in found] == [text(one) for one in "cde"]
            with ros.peer("late") as late:
                await ask(late, "listen", topic="/ours", history=True, **STRING)
                found = await asyncio.to_thread(late.wait, "/ours", 3)
                assert [one["cdr"] for one in found] == [text(one) for one in "cde"]


@on_one_loop
async def test_nothing_of_a_lossless_publisher_is_lost(ros: Ros) -> None:
    bridge = ros.bridge()
    with ros.peer() as far:
        async with ros.side.node("talker") as node:
            lossless = bus.QoSProfile(history="keep_all")
            publisher = await node.create_publisher(String, "/chatter", lossless)
            await ask(far, "listen", topic="/chatter", **STRING)
            await publisher.wait_for_subscriptions()
            for number in range(3000):
                await publisher.send(String(data=f"{number} {3000 * 'x'}"))
        found = await asyncio.to_thread(far.wait, "/chatter", 3000)
        assert [one["number"] for one in found] == [*range(1, 3001)], bridge.status()


@ONE_WAY
@on_one_loop
async def test_ros_2_calls_a_server_of_the_bus(ros: Ros, by: Way) -> None:
    bridge = ros.bridge(by=by)

    def answer(request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=request.data, message="here")

    async with ros.side.node("server") as node:
        server = await node.create_service(SetBool, "/ours", answer)
        with ros.peer() as far:
            call = {"service": "/ours", "request": cdr(_ASK, True), **SET_BOOL}
            found = await ask(far, "call", **call)
            assert [fields(_ANSWER, one) for one in found] == [[True, "here"]]
            found = await ask(far, "call", **call, count=100)
            assert [fields(_ANSWER, one) for one in found] == 100 * [[True, "here"]]
            assert server.statistics().requests == 101
            assert await ask(far, "call", **{**call, "request": "00010000"}, time_s=0.5) == [None]
    await until(lambda: "gets no answer" in bridge.log.read_text())


@ONE_WAY
@on_one_loop
async def test_the_bus_calls_a_server_of_ros_2(ros: Ros, by: Way) -> None:
    ros.bridge(by=by)
    answer = cdr(_ANSWER, True, "there")
    async with ros.side.node("client") as node:
        client = await node.create_client(SetBool, "/theirs")
        with ros.peer() as far:
            await ask(far, "offer", service="/theirs", answer=answer, **SET_BOOL)
            await client.wait_for_service()
            found = await asyncio.gather(*(client.call(SetBool.Request(data=True)) for _ in range(100)))
            assert found == 100 * [SetBool.Response(success=True, message="there")]
            requests = await asyncio.to_thread(far.wait, "/theirs", 100)
            assert sorted(one["number"] for one in requests) == [*range(1, 101)]
            assert [fields(_ASK, one["cdr"]) for one in requests] == 100 * [[True]]
            (token,) = (gid for key, gid in (await ask(far, "tokens")).items() if "/SC/%busd%" in key)
            assert {one["gid"] for one in requests} == {token}
            await ask(far, "offer", service="/slow", answer=answer, pause_s=100.0, **SET_BOOL)
            slow = await node.create_client(SetBool, "/slow")
            await slow.wait_for_service()
            task = asyncio.create_task(slow.call(SetBool.Request()))
            await asyncio.to_thread(far.wait, "/slow")
            far.kill()
            with pytest.raises((ServiceUnavailable, bus.ServiceError)):
                await task


@on_one_loop
async def test_parameters_of_a_node_of_the_bus(ros: Ros) -> None:
    ros.bridge()
    asked, answered = service_codecs(LIST)
    kind: Any = service_class(LIST)
    async with ros.side.node("robot") as node:
        await node.declare_parameter("speed", 3)
        with ros.peer() as far:
            request = cdr(asked, [], 0)
            (found,) = await ask(
                far, "call", service="/robot/list_parameters", request=request, **service_kind(LIST)
            )
            assert "speed" in fields(answered, found)[0][0]
            await ask(
                far,
                "offer",
                service="/far/list_parameters",
                answer=cdr(answered, [["depth"], []]),
                **service_kind(LIST),
            )
            client = await node.create_client(kind, "/far/list_parameters")
            await client.wait_for_service()
            assert (await client.call(kind.Request())).result.names == ["depth"]


@pytest.fixture
def fibonacci(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(SHARE))
    return bus_actions.find_action(FIBONACCI)


@on_one_loop
async def test_ros_2_sends_a_goal_to_an_action_of_the_bus(ros: Ros, fibonacci: Any) -> None:
    ros.bridge()

    async def execute(goal: Any) -> Any:
        for number in range(3):
            yield fibonacci.Feedback(sequence=[number])
        yield fibonacci.Result(sequence=[*range(goal.request.order)])

    async with ros.side.node("robot") as node, bus_actions.ActionServer(node, fibonacci, "/count", execute):
        with ros.peer() as far:
            feedback = f"{FIBONACCI}_FeedbackMessage"
            await ask(far, "listen", topic="/count/_action/feedback", **kind_of(feedback))
            asked, answered = service_codecs(f"{FIBONACCI}_SendGoal")
            call = {"service": "/count/_action/send_goal", "request": cdr(asked, [GOAL], [4])}
            (found,) = await ask(far, "call", **call, **service_kind(f"{FIBONACCI}_SendGoal"))
            assert fields(answered, found)[0] is True
            asked, answered = service_codecs(f"{FIBONACCI}_GetResult")
            call = {"service": "/count/_action/get_result", "request": cdr(asked, [GOAL])}
            (found,) = await ask(far, "call", **call, **service_kind(f"{FIBONACCI}_GetResult"))
            assert fields(answered, found) == [4, [[0, 1, 2, 3]]]
            heard = await asyncio.to_thread(far.wait, "/count/_action/feedback", 3)
            codec = message_codec(feedback)
            assert [fields(codec, one["cdr"])[1] for one in heard] == [[[0]], [[1]], [[2]]]


@on_one_loop
async def test_the_bus_sends_a_goal_to_an_action_of_ros_2(ros: Ros, fibonacci: Any) -> None:
    ros.bridge()
    with ros.peer() as far:
        feedback, status = f"{FIBONACCI}_FeedbackMessage", "action_msgs/msg/GoalStatusArray"
        await ask(far, "publish", topic="/count/_action/feedback", **kind_of(feedback))
        await ask(far, "publish", topic="/count/_action/status", kept=1, **kind_of(status))
        for part, kind, answer in (
            ("send_goal", f"{FIBONACCI}_SendGoal", (True, [0, 0])),
            ("get_result", f"{FIBONACCI}_GetResult", (4, [[5, 8]])),
            ("cancel_goal", "action_msgs/srv/CancelGoal", (1, [])),
        ):
            await ask(
                far,
                "offer",
                service=f"/count/_action/{part}",
                answer=cdr(service_codecs(kind)[1], *answer),
                pause_s=0.5 if part == "get_result" else 0.0,
                **service_kind(kind),
            )
        async with (
            ros.side.node("robot") as node,
            bus_actions.ActionClient(node, fibonacci, "/count") as client,
        ):
            await client.wait_for_server()
            goal = await client.send_goal(fibonacci.Goal(order=4))
            (request,) = await asyncio.to_thread(far.wait, "/count/_action/send_goal")
            (number,), (order,) = fields(service_codecs(f"{FIBONACCI}_SendGoal")[0], request["cdr"])
            assert order == 4
            message = cdr(message_codec(feedback), [number], [[7]])
            await ask(far, "send", topic="/count/_action/feedback", messages=[message])
            assert [one.sequence async for one in goal] == [[7]]
            assert (await goal.result()).sequence == [5, 8]


@WAYS
@on_one_loop
async def test_the_router_and_the_bridge_come_back(ros: Ros, by: Way) -> None:
    bridge = ros.bridge(by=by)
    heard: list[str] = []
    with ros.peer() as far:
        async with ros.side.node("listener") as node:
            await node.create_subscription(String, "/chatter", 100, lambda one: heard.append(one.data))
            await ask(far, "publish", topic="/chatter", **STRING)
            await ros.side.shows(lambda graph: graph.publishers_of("/chatter"))
            bridge.kill()
            await ros.side.shows(lambda graph: not graph.publishers_of("/chatter"))
            await until(lambda: not [one for one in far.ask("tokens") if "/MS/" in one])
            bridge.restart()
            await ros.side.shows(lambda graph: graph.publishers_of("/chatter"))
            ros.router.kill()
            ros.router.start()

            def is_heard() -> bool:
                far.ask("send", topic="/chatter", messages=[text("again")])
                return "again" in heard

            await until(is_heard)


@on_one_loop
async def test_a_rule_sets_the_priority(ros: Ros, tmp_path: Path) -> None:
    file = tmp_path / "rules.toml"
    rules = [f'[[bridge.ros2.topics]]\npattern = "/{name}"\npriority = "real_time"' for name in ("a", "b")]
    file.write_text("\n".join(rules))
    ros.bridge("--config", str(file))
    with ros.peer() as far:
        async with ros.side.node("talker") as node:
            for name, durability in (("a", "volatile"), ("b", "transient_local"), ("c", "volatile")):
                qos = bus.QoSProfile(durability=durability)
                publisher = await node.create_publisher(String, f"/{name}", qos)
                await ask(far, "listen", topic=f"/{name}", **STRING)
                await publisher.wait_for_subscriptions()
                publisher.publish(String(data="x"))
                (message,) = await asyncio.to_thread(far.wait, f"/{name}")
                expected = "DATA" if name == "c" else "REAL_TIME"
                assert message["priority"].rpartition(".")[2] == expected, message


@on_one_loop
async def test_a_session_that_exceeds_a_limit_is_refused_alone(ros: Ros) -> None:
    bridge = ros.bridge()
    with ros.peer("calm") as calm, ros.peer("crowd") as crowd:
        await ros.side.shows(lambda graph: {"/calm", "/crowd"} <= {one.full_name for one in graph.nodes})
        await ask(crowd, "crowd", count=1500)
        await until(lambda: "is refused" in bridge.log.read_text())
        await ask(calm, "publish", topic="/chatter", **STRING)
        graph = await ros.side.shows(lambda graph: graph.publishers_of("/chatter") and len(graph.nodes) < 5)
        assert "/crowd" not in {one.full_name for one in graph.nodes}
        links = [link["text"] for link in bridge.status()["links"]]
        assert "1 session, 1 refused" in links
    assert "a token of ROS 2 is left out" in bridge.log.read_text()


@on_one_loop
async def test_rules_domains_and_namespaces(ros: Ros) -> None:
    ros.bridge("--namespace", "/bot", "--deny", "/secret")
    with ros.peer() as far, ros.peer("elsewhere", ros.domain + 1) as other:
        for one in (far, other):
            await ask(one, "publish", topic="/bot/chatter", **STRING)
            await ask(one, "publish", topic="/bot/secret", **STRING)
        async with ros.side.node("talker") as node:
            await node.create_publisher(String, "/ours", 10)
            await node.create_publisher(String, "/secret", 10)
            graph = await ros.side.shows(lambda graph: graph.publishers_of("/chatter"))
            assert len(graph.publishers_of("/chatter")) == 1
            assert len(graph.publishers_of("/secret")) == 1
            await until(lambda: any("%bot%ours" in key for key in far.ask("tokens")))
            assert not [key for key in await ask(far, "tokens") if "%busd%" in key and "secret" in key]
            assert not [key for key in await ask(other, "tokens") if "%busd%" in key]

"""`bus bridge zenoh`: two buses on two machines; unplugged cables and killed processes."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager, AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

import bus
from bridged_world import Stream, World, on_one_loop, until
from bus.msg.std_msgs import String
from bus.srv.example_interfaces import AddTwoInts
from certificates import make_certificates
from conftest import WAIT_S
from forks import Forks

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed: make setup installs it")

KEEP_ALL = bus.QoSProfile(history="keep_all")
LATCHED = bus.QoSProfile(1, durability="transient_local")
LATE = bus.QoSProfile(10, durability="transient_local")
"""Room for the samples of several latched publishers."""
LEASE_S = 10.0
"""zenoh declares a silent link dead after so long."""


@pytest.fixture
def world(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "robot", "laptop") as world:
        yield world


class Talk(NamedTuple):
    """A stream in each direction."""

    there: Stream
    back: Stream

    async def flow(self) -> None:
        await asyncio.gather(self.there.flows(), self.back.flows())

    async def missing(self) -> tuple[int, int]:
        """Stops both streams; the number of missing messages in each."""
        for one in self:
            await one.stop()
            one.say()
        for one in self:
            await one.arrived()
        return self.there.check(), self.back.check()


@asynccontextmanager
async def talking(world: World, hz: float = 100.0) -> AsyncIterator[Talk]:
    """Both sides talk and listen to each other."""
    async with (
        world["robot"].node("robot_node") as robot,
        world["laptop"].node("laptop_node") as laptop,
        Stream.open("/there", robot, laptop, hz=hz) as there,
        Stream.open("/back", laptop, robot, hz=hz) as back,
    ):
        talk = Talk(there, back)
        await talk.flow()
        yield talk


# --- messages


@on_one_loop
async def test_a_talker_is_seen_and_heard_on_the_other_bus_as_if_it_were_there(world: World) -> None:
    robot, laptop = world["robot"], world["laptop"]
    world.join_by_zenoh()
    async with robot.node("talker", namespace="/bot") as node:
        publisher = await node.create_publisher(String, "chatter", bus.QoSProfile(5))
        graph = await laptop.shows(lambda graph: graph.publishers_of("/bot/chatter"))
        (mirror,) = graph.publishers_of("/bot/chatter")
        assert mirror.gid == publisher.gid and mirror.qos == bus.QoSProfile(5)
        assert "/bot/talker" in laptop.bus("node", "list").out
        with laptop.start("topic", "echo", "/bot/chatter", "--once") as echo:
            await until(lambda: publisher.get_subscription_count() == 1)  # the echo's, by its mirror
            publisher.publish(String(data="Hello"))
            assert await asyncio.to_thread(echo.line) == "data: Hello"
        await until(lambda: publisher.get_subscription_count() == 0)
    await laptop.shows(lambda graph: not graph.publishers_of("/bot/chatter"))
    await until(lambda: "/bot/talker" not in laptop.names())  # the node goes after its endpoints


@on_one_loop
async def test_streams_both_ways_lose_nothing_and_keep_whose_they_are_and_their_times(world: World) -> None:
    one, other = world.join_by_zenoh()
    async with talking(world, hz=500) as talk:
        await until(lambda: len(talk.there.heard) > 200 and len(talk.back.heard) > 200)
        assert await talk.missing() == (0, 0)
        for stream in talk:
            assert {info.publisher_gid for info in stream.infos} == {stream.publisher.gid}
            ages = [info.received_timestamp - info.source_timestamp for info in stream.infos]
            assert all(0 < age < WAIT_S * 1e9 for age in ages)
        await until(
            lambda: one.route("/there", "out")["sent"] >= talk.there.sent,
            lambda: f"{talk.there.sent}, {talk.there.heard[0]}: {one.route('/there', 'out')}",
        )
        for bridge, topic in ((one, "/there"), (other, "/back")):
            route = bridge.route(topic, "out")
            assert route["taken"] == route["sent"] + route["waiting"] + sum(route["dropped"].values())
    one.end()
    other.end()
    for side in world.sides:
        await until(lambda side=side: not side.names())


@pytest.mark.parametrize("of_the_robot", [(), ("--compression",)], ids=["one", "both"])
@on_one_loop
async def test_a_link_compresses_if_both_sides_do(world: World, of_the_robot: tuple[str, ...]) -> None:
    world.join_by_zenoh(listening=of_the_robot, connecting=("--compression",))
    cable = world.cable()
    async with world["robot"].node("robot_node") as robot, world["laptop"].node("laptop_node") as laptop:
        subscription = await laptop.create_subscription(String, "text", KEEP_ALL)
        publisher = await robot.create_publisher(String, "text", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        before = cable.sent_by("robot")
        for number in range(20):
            await publisher.send(String(data=f"{number} " + "the quick brown fox " * 5000))
        for number in range(20):
            message, _ = await subscription.receive()
            assert message.data.startswith(f"{number} the quick")
        sent = cable.sent_by("robot") - before
    assert (sent < 500_000) is bool(of_the_robot), f"{sent} bytes for 2 MB of text"


@on_one_loop
async def test_each_of_two_latched_publishers_reaches_a_late_joiner(world: World) -> None:
    world.join_by_zenoh()
    async with (
        world["robot"].node("one") as one,
        world["robot"].node("other") as other,
        world["laptop"].node("late") as late,
    ):
        for node in (one, other):
            publisher = await node.create_publisher(String, "/tf_static", LATCHED)
            publisher.publish(String(data="earlier"))
            publisher.publish(String(data=node.name))
        await world["laptop"].shows(lambda graph: len(graph.publishers_of("/tf_static")) == 2)
        for _ in range(2):  # the second joiner gets the same samples
            heard: list[str] = []
            await late.create_subscription(
                String, "/tf_static", LATE, lambda message, into=heard: into.append(message.data)
            )
            await until(
                lambda into=heard: len(into) >= 2,
                lambda into=heard: f"two messages: {into}; {_routes(world)}",
            )
            assert sorted(heard) == ["one", "other"]


@on_one_loop
async def test_what_is_lossless_loses_nothing_though_the_far_side_is_slow(world: World) -> None:
    world.join_by_zenoh()
    count = 3000
    async with (
        world["robot"].node("talker") as talker,
        world["laptop"].node("listener") as listener,
        Stream.open("/lossless", talker, listener, KEEP_ALL, hz=0) as stream,
    ):
        await stream.publisher.wait_for_subscriptions()
        for number in range(1, count + 1):
            await stream.publisher.send(String(data=str(number)))
            if number % 1000 == 0:
                time.sleep(0.2)  # noqa: ASYNC251
        await until(lambda: len(stream.heard) == count)
        assert stream.heard == list(range(1, count + 1))


@on_one_loop
async def test_services_are_called_across(world: World) -> None:
    world.join_by_zenoh()

    def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
        return AddTwoInts.Response(sum=request.a + request.b)

    async with world["robot"].node("server") as server:
        await server.create_service(AddTwoInts, "/add", add)
        await world["laptop"].shows(lambda graph: "/add" in graph.services())
        words = ("service", "call", "/add", "example_interfaces/srv/AddTwoInts", "{a: 2, b: 40}")
        for _ in range(3):
            called = await asyncio.to_thread(world["laptop"].bus, *words)
            assert called.code == 0 and "42" in called.out, called


@on_one_loop
async def test_a_latched_publisher_flows_only_while_somebody_listens(world: World) -> None:
    """Its route keeps samples for late joiners, but does not flow without a subscription."""
    one, _ = world.join_by_zenoh()
    async with world["robot"].node("robot_node") as robot, world["laptop"].node("laptop_node") as laptop:
        publisher = await robot.create_publisher(String, "/map", LATCHED)
        publisher.publish(String(data="map"))
        await world["laptop"].shows(lambda graph: graph.publishers_of("/map"))
        assert not one.route("/map", "out")["is_flowing"]
        subscription = await laptop.create_subscription(String, "/map", LATCHED)
        assert (await subscription.receive())[0].data == "map"
        assert one.route("/map", "out")["is_flowing"]
        await subscription.close()
        await world["robot"].shows(lambda graph: not graph.subscriptions_of("/map"))
        await until(lambda: not one.route("/map", "out")["is_flowing"], "nobody listens")


def _routes(world: World) -> list[object]:
    return [bridge.status()["routes"] for bridge in world.bridges]


# --- faults


class Fault(NamedTuple):
    name: str
    happens: Callable[[World], AbstractContextManager[object]]
    lasts_s: float


FAULTS = (
    Fault("cable pulled", lambda world: world.cable().pulled(), 4.0),
    Fault("cable pulled for longer than the lease", lambda world: world.cable().pulled(), 1.3 * LEASE_S),
    Fault("interface down", lambda world: world.cable().down(), 4.0),
    Fault("far bridge stopped", lambda world: world["laptop"].bridges[0].stopped(), 4.0),
    Fault("far bridge stopped for long", lambda world: world["laptop"].bridges[0].stopped(), 1.3 * LEASE_S),
    Fault("near bridge stopped", lambda world: world["robot"].bridges[0].stopped(), 4.0),
)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
@on_one_loop
async def test_after_a_fault_all_flows_again_and_losses_are_counted(world: World, fault: Fault) -> None:
    one, other = world.join_by_zenoh()
    async with talking(world) as talk:
        with fault.happens(world):
            await asyncio.sleep(fault.lasts_s)
        await talk.flow()
        missing = await talk.missing()
        for stream, out, into, lost in zip(talk, (one, other), (other, one), missing, strict=True):
            sent, came = out.route(stream.topic, "out"), into.route(stream.topic, "in")
            here = stream.subscription.statistics().dropped
            counted = sum(sent["dropped"].values()) + sum(came["dropped"].values()) + sum(here.values())
            passed_over = stream.sent - sent["taken"]  # while the far bus counted as gone
            assert lost <= counted + passed_over, f"{lost} are missing: {sent}, {came}, {here}"
            assert sent["taken"] == sent["sent"] + sent["waiting"] + sum(sent["dropped"].values())
            assert not sent["is_stuck"] and not came["is_stuck"]


@on_one_loop
async def test_who_is_refused_is_counted_and_said(world: World, tmp_path: Path) -> None:
    where = world.lay("robot", "laptop").replace("tcp/", "tls/")
    ends = [world.cable().address_of(name) for name in ("robot", "laptop")]
    ours = make_certificates(tmp_path, "robot", addresses=ends)["robot"]
    theirs = make_certificates(tmp_path, "laptop", authority="stranger", addresses=ends)["laptop"]
    bridges = [
        world[name].bridge(
            *("zenoh", flag, where, "--ca", str(ours.ca)),
            *("--certificate", str(own.certificate), "--key", str(own.key)),
        )
        for name, flag, own in (("robot", "--listen", ours), ("laptop", "--connect", theirs))
    ]
    await until(lambda: "refused" in bridges[0].log.read_text())
    await until(lambda: bridges[0].status()["refused"] > 1)
    shown = await asyncio.to_thread(world["robot"].bus, "bridge", "status")
    assert re.search(
        r"^refused +\d+ connections, the last one because: .*certificate", shown.out, re.M | re.I
    )
    assert "refused: " in bridges[0].log.read_text()
    metrics = await asyncio.to_thread(world["robot"].bus, "metrics", "--once")
    assert re.search(r'^busd_bridge_refused_total\{bridge="/bridge_zenoh"\} [1-9]', metrics.out, re.M)
    assert not bridges[0].status()["buses"]


@pytest.mark.nightly
@pytest.mark.parametrize("protocol", ["tcp", "tls"])
@on_one_loop
async def test_a_full_link_is_given_up_while_its_cable_is_out(
    world: World, tmp_path: Path, protocol: str
) -> None:
    where = world.lay("robot", "laptop").replace("tcp/", f"{protocol}/")
    ends = [world.cable().address_of(name) for name in ("robot", "laptop")]
    made = make_certificates(tmp_path, "robot", "laptop", addresses=ends)
    bridges = []
    for name, flag in (("robot", "--listen"), ("laptop", "--connect")):
        ca, certificate, key = map(str, made[name])
        proof = (
            ("--ca", ca, "--certificate", certificate, "--key", key) if protocol == "tls" else ("--insecure",)
        )
        bridges.append(world[name].bridge("zenoh", flag, where, *proof))
    heard: list[int] = []
    lossless = bus.QoSProfile(history="keep_all")
    async with world["robot"].node("robot_node") as robot, world["laptop"].node("laptop_node") as laptop:
        await laptop.create_subscription(
            String, "/full", lossless, lambda message: heard.append(len(message.data))
        )
        publisher = await robot.create_publisher(String, "/full", lossless)
        await publisher.wait_for_subscriptions()
        filling = asyncio.create_task(_fill(publisher))
        await until(lambda: len(heard) > 100)
        with world.cable().pulled():
            for one in bridges:
                await until(lambda one=one: not one.status()["buses"], "given up", LEASE_S + WAIT_S)
        before = len(heard)
        await until(lambda: len(heard) > before + 100, "it flows again")
        filling.cancel()
        await asyncio.gather(filling, return_exceptions=True)


async def _fill(publisher: bus.Publisher[String]) -> None:
    """Publishes large messages forever."""
    while True:
        if not publisher.publish(String(data="x" * 10_000)):
            await publisher.wait_for_room()
        await asyncio.sleep(0.001)


@pytest.mark.nightly
@on_one_loop
async def test_what_is_latched_comes_once_though_the_link_was_given_up(world: World) -> None:
    one, _ = world.join_by_zenoh()
    async with (
        world["robot"].node("robot_node") as robot,
        world["laptop"].node("laptop_node") as laptop,
        Stream.open(
            "/latched", robot, laptop, bus.QoSProfile(3, durability="transient_local"), hz=0
        ) as stream,
    ):
        for _ in range(3):
            stream.say()
        await until(lambda: stream.heard == [1, 2, 3])
        with world["laptop"].bridges[0].stopped():
            await until(lambda: not one.status()["buses"], "the link is given up")
            stream.say()
        await until(lambda: stream.heard == [1, 2, 3, 4], lambda: f"heard {stream.heard}")
        late: list[str] = []
        await laptop.create_subscription(
            String, "/latched", stream.publisher.qos, lambda message: late.append(message.data)
        )
        await until(lambda: late == ["2", "3", "4"], lambda: f"a late joiner heard {late}")
        stream.say()
        await until(lambda: late[-1] == "5")
        assert stream.heard == [1, 2, 3, 4, 5]


@pytest.mark.nightly
@pytest.mark.parametrize("side", ["robot", "laptop"])
@pytest.mark.parametrize("victim", ["bridge", "busd"])
@on_one_loop
async def test_whoever_is_killed_and_comes_back_all_flows_again(world: World, victim: str, side: str) -> None:
    world.join_by_zenoh()
    async with talking(world) as talk:
        for _ in range(2):
            killed = world[side].daemon if victim == "busd" else world[side].bridges[0]
            killed.kill()
            await asyncio.sleep(0.5)  # it is away for so long
            killed.restart()
            await talk.flow()
        await talk.missing()
    await until(lambda: world["robot"].names() <= {"/bridge_zenoh"}, "mirrors go")
    await until(lambda: world["laptop"].names() <= {"/bridge_zenoh"}, "mirrors go")


@on_one_loop
async def test_a_bridge_that_is_killed_comes_back_without_copies(world: World) -> None:
    _, far = world.join_by_zenoh()
    async with talking(world) as talk:
        far.kill()
        await world["laptop"].shows(lambda graph: not graph.publishers_of("/there"))
        far.restart()
        await talk.flow()
        await talk.missing()


@pytest.mark.parametrize("how", ["kill", "end"])
@on_one_loop
async def test_messages_that_a_bridge_missed_while_it_was_away_are_counted(world: World, how: str) -> None:
    _, far = world.join_by_zenoh()
    async with talking(world) as talk:
        # A bridge notes a message first and then hands it over: a kill in between would leave it in no count.
        await talk.there.stop()
        await talk.there.arrived()
        before = talk.there.sent
        getattr(far, how)()
        for _ in range(20):
            talk.there.say()
        far.restart()
        while talk.there.heard[-1] == before:
            talk.there.say()
            await asyncio.sleep(0.01)
        missing, _ = await talk.missing()
        await until(
            lambda: far.route("/there", "in")["dropped"].get("lost_on_the_way") == missing,
            lambda: f"{missing}: {far.status()}",
        )
    assert missing >= 20


@pytest.mark.nightly
@on_one_loop
async def test_twenty_restarts_make_no_copies(world: World) -> None:
    bridges = world.join_by_zenoh()
    async with talking(world) as talk:
        for number in range(20):
            bridge = bridges[number % 2]
            bridge.end()
            bridge.restart()
            await talk.flow()
        await talk.missing()
        graph = world["laptop"].graph()
        assert len(graph.publishers_of("/there")) == len(graph.publishers_of("/back")) == 1


@pytest.mark.nightly
@on_one_loop
async def test_what_waits_for_a_bridge_that_hangs_holds_up_neither_loop_nor_others(world: World) -> None:
    """Only the lossless stream stops; a lossy stream to the other machine and both buses continue."""
    world.join_by_zenoh()
    async with (
        world["robot"].node("talker") as talker,
        world["laptop"].node("listener") as listener,
        Stream.open("/lossless", talker, listener, KEEP_ALL, hz=0) as stream,
        talking(world) as talk,
    ):
        await stream.publisher.wait_for_subscriptions()
        sending = asyncio.create_task(_send(stream, 20_000))
        with world["laptop"].bridges[0].stopped():
            await asyncio.sleep(3)
            assert world["robot"].bridges[0].status()["links"], "it answers"
        await asyncio.wait_for(sending, 2 * WAIT_S)
        await until(lambda: len(stream.heard) == 20_000)
        assert stream.check() == 0
        await talk.flow()
        await talk.missing()


async def _send(stream: Stream, count: int) -> None:
    for number in range(1, count + 1):
        await stream.publisher.send(String(data=str(number)))


@pytest.mark.nightly
@on_one_loop
async def test_two_hundred_nodes_at_once(world: World) -> None:
    world.join_by_zenoh()
    publishers: list[bus.Publisher[String]] = []
    async with AsyncExitStack() as stack:
        for number in range(200):
            node = await stack.enter_async_context(world["robot"].node(f"node_{number}"))
            publishers.append(await node.create_publisher(String, f"/many/t{number}", 10))
        await world["laptop"].shows(lambda graph: _many(graph) == 200)
        heard: list[str] = []
        async with world["laptop"].node("listener") as listener:
            for number in range(200):
                await listener.create_subscription(
                    String, f"/many/t{number}", 10, lambda message: heard.append(message.data)
                )
            await world["robot"].shows(
                lambda graph: sum(one.topic.startswith("/many") for one in graph.subscriptions) == 200
            )
            for publisher in publishers:
                publisher.publish(String(data=publisher.gid.hex()))
            await until(lambda: len(set(heard)) == 200)
    await world["laptop"].shows(lambda graph: _many(graph) == 0)


def _many(graph: bus.Graph) -> int:
    return sum(one.topic.startswith("/many") for one in graph.publishers)

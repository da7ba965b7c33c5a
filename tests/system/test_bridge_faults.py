"""Bridges, busds and links that fail and return, and far sides that send wrong data."""

import asyncio
from collections.abc import Callable
from time import process_time
from typing import Any

import pytest

import bus
from bridging import KEPT, LATCHED, LOSSLESS, Made, Talk, World, received, world
from bus.msg.std_msgs import Int32, String
from bus_bridge.batch import Sample
from bus_bridge.core import export, far_reading, staying
from bus_bridge.core.bounds import Bounds
from bus_bridge.engine import FarBus, FarEndpoint, FarNode
from bus_bridge.errors import BridgeError
from conftest import WAIT_S
from engine_pair import WINDOW_BYTES
from semantics import until

__all__ = ["world"]


async def test_a_link_that_goes_and_comes_back(world: Made) -> None:
    async with world() as made:
        talk = await made.talk()
        keeper, listener = await talk.left.node("keeper"), await talk.right.node("state_listener")
        publisher = await keeper.create_publisher(Int32, "state", LATCHED)
        state = await listener.create_subscription(Int32, "state", KEPT)
        publisher.publish(Int32(data=7))
        assert await received(state, 1) == [7]
        for _ in range(3):
            await talk.exchange()
            await talk.cut()
            talk.link.up()
        await talk.exchange()
        late = await listener.create_subscription(Int32, "state", KEPT)
        assert await received(late, 1) == [7]
        assert state.take() is None  # it has received it already


async def test_what_is_missed_while_a_link_is_down_is_counted(world: Made) -> None:
    async with world() as made:
        talk = await made.talk()
        await talk.exchange()
        await talk.cut()
        for number in range(3):
            talk.publisher.publish(Int32(data=number))
        talk.link.up()
        await talk.exchange()
        talk.publisher.publish(Int32(data=-1))
        assert await received(talk.subscription, 1) == [-1]
        (route,) = talk.other.bridge.status().routes
        assert route.dropped["lost_on_the_way"] >= 3
        assert route.sent + route.dropped["lost_on_the_way"] == talk.publisher.statistics().published


async def test_what_is_missed_while_the_importing_bridge_is_killed_is_counted(world: Made) -> None:
    """The other bridge counts them: the restarted one has no earlier state."""
    async with world() as made:
        talk = await made.talk(10)
        await talk.exchange()
        before = sum(talk.one.bridge.status().routes[0].dropped.values())
        await talk.cut()
        for _ in range(3):
            talk.publisher.publish(Int32(data=0))
        await talk.other.restart()
        talk.link.up()
        await talk.is_on()
        talk.publisher.publish(Int32(data=-1))
        assert await received(talk.subscription, 1) == [-1]
        (route,) = talk.one.bridge.status().routes
        assert route.dropped == {"not_wanted": before + 3}
        assert route.taken == talk.publisher.statistics().published


async def test_what_is_latched_comes_once_though_nodes_go_before_their_bus(world: Made) -> None:
    """At the end of a link, an engine may report its nodes one by one."""
    async with world() as made:
        talk = await made.talk(KEPT)
        talk.publisher.publish(Int32(data=7))
        assert await received(talk.subscription, 1) == [7]
        for node in tuple(talk.other.bridge._far.nodes):
            talk.other.bridge.node_removed(node)
        await asyncio.sleep(0.05)
        talk.link.down()
        await until(lambda: talk.publisher.get_subscription_count() == 0)
        talk.link.up()
        await talk.publisher.wait_for_subscriptions()
        talk.publisher.publish(Int32(data=8))
        assert await received(talk.subscription, 1) == [8]


async def test_what_is_latched_is_there_for_late_joiners_however_long_the_link_was_down(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(staying, "_LINGER_S", 0.0)
    monkeypatch.setattr(staying, "_GONE_S", 0.0)
    async with world() as made:
        talk = await made.talk(LATCHED, heard=KEPT)
        talk.publisher.publish(Int32(data=7))
        assert await received(talk.subscription, 1) == [7]
        await talk.cut()
        talk.link.up()
        await talk.subscription.wait_for_publishers()
        late = await (await talk.right.node("late")).create_subscription(Int32, "numbers", KEPT)
        assert await received(late, 1) == [7]


async def test_bridges_that_restart_leave_no_copies(world: Made) -> None:
    async with world() as made:
        talk = await made.talk()
        for number in range(20):
            await (talk.one, talk.other)[number % 2].restart()
        await talk.exchange()
        graph = await (await talk.right.node("watcher")).graph()
        assert len(graph.publishers_of("/numbers")) == 1
        assert len(graph.taps) <= 2


@pytest.mark.parametrize("side", ["left", "right"])
async def test_a_busd_that_is_killed_and_comes_back(world: Made, side: str) -> None:
    async with world() as made:
        talk = await made.talk()
        await talk.exchange()
        site = talk.left if side == "left" else talk.right
        engines = talk.one.engine, talk.other.engine
        before = [len(engine.announced) for engine in engines]
        site.daemon.kill()
        site.daemon.restart()
        observer = await site.node("observer")
        await observer.wait_for_graph(
            lambda graph: (
                len(graph.publishers_of("/numbers")) == 1 and len(graph.subscriptions_of("/numbers")) == 1
            )
        )
        await talk.exchange()
        again = [
            one for engine, count in zip(engines, before, strict=True) for one in engine.announced[count:]
        ]
        assert [one.topic for one in again if one.topic == "/numbers"] == []


async def test_what_is_missed_while_busd_is_away_is_counted(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(far_reading, "_LINGER_S", 0.0)
    async with world() as made:
        talk = await made.talk()
        await talk.exchange()
        talk.right.daemon.kill()
        await until(lambda: not any(route.is_flowing for route in talk.one.bridge.status().routes))
        for number in range(30):  # the publisher keeps the last ten for it
            talk.publisher.publish(Int32(data=number))
        talk.right.daemon.restart()
        assert await received(talk.subscription, 10) == [*range(20, 30)]
        (route,) = talk.other.bridge.status().routes
        assert route.sent + route.dropped["lost_on_the_way"] == talk.publisher.statistics().published


async def test_it_ends_and_its_mirrors_with_it(world: Made) -> None:
    async with world() as made:
        left, right, one, _ = await made.pair()
        talker, watcher = await left.node("talker"), await right.node("watcher")
        for number in range(50):
            await talker.create_publisher(Int32, f"numbers{number}", 10)
        await watcher.wait_for_graph(lambda graph: len(graph.publishers) > 50)
        await one.stop()
        await watcher.wait_for_graph(
            lambda graph: all(node.origin is None or node.name == "bridge_pair" for node in graph.nodes)
        )


@pytest.mark.landing
async def test_many_nodes_at_once_and_quiet_afterwards(world: Made) -> None:
    async with world() as made:
        left, right, _, other = await made.pair()
        watcher = await right.node("watcher")
        nodes = [bus.Node(f"node{n}", arguments=[], socket=left.socket, rosout=False) for n in range(200)]
        await asyncio.gather(*(node.open() for node in nodes))
        publishers = [await node.create_publisher(Int32, f"topic{n}", 10) for n, node in enumerate(nodes)]
        await watcher.wait_for_graph(
            lambda graph: sum(one.topic.startswith("/topic") for one in graph.publishers) == 200
        )
        subscriptions = [await watcher.create_subscription(Int32, f"topic{n}", 10) for n in range(200)]
        for publisher in publishers:
            await publisher.wait_for_subscriptions()
        await until(lambda: sum(route.is_flowing for route in other.bridge.status().routes) == 200)
        for number, publisher in enumerate(publishers):
            publisher.publish(Int32(data=number))
        for number, subscription in enumerate(subscriptions):
            assert await received(subscription, 1) == [number]
        assert not any(route.is_stuck for route in other.bridge.status().routes)
        await asyncio.gather(*(node.close() for node in nodes))
        await watcher.wait_for_graph(lambda graph: not any(p.topic == "/topic7" for p in graph.publishers))
        await until(lambda: other.bridge.status().shown_here.nodes <= 1)
        busy_s = 1.0
        async with asyncio.timeout(WAIT_S):
            while busy_s > 0.05:  # of 0.5 s: both bridges and everything else here
                before_s = process_time()
                await asyncio.sleep(0.5)
                busy_s = process_time() - before_s


async def test_a_lossless_route_that_hangs_holds_up_no_other(world: Made) -> None:
    async with world() as made:
        talk = await made.talk(LOSSLESS, kind=String)
        bystander = await talk.left.node("bystander")
        here = await bystander.create_publisher(Int32, "here", 10)
        local = await bystander.create_subscription(Int32, "here", 10)
        await talk.publisher.wait_for_subscriptions()
        await until(lambda: any(route.is_flowing for route in talk.one.bridge.status().routes))
        talk.link.hang()
        text = "x" * 10_000

        async def flood() -> None:
            for _ in range(2000):
                await talk.publisher.send(String(data=text))

        flooding = asyncio.create_task(flood())
        for number in range(100):
            here.publish(Int32(data=number))
            assert await received(local, 1) == [number]
        (route,) = [one for one in talk.one.bridge.status().routes if one.topic == "/numbers"]
        assert route.waiting < 2000
        assert not flooding.done()
        talk.link.go_on()
        assert await received(talk.subscription, 2000) == [text] * 2000
        await flooding


async def one_stuck(made: World, kind: Any) -> tuple[Talk, bus.Publisher[Any], Callable[[], None]]:
    """A lossless talk with a blocked route, a publisher with a free one, and a call to unblock the first."""
    talk = await made.talk(LOSSLESS, kind=kind)
    other = await (await talk.left.node("other")).create_publisher(kind, "numbers", LOSSLESS)
    await talk.publisher.wait_for_subscriptions()
    await until(lambda: sum(way.is_flowing for way in talk.one.bridge.status().routes) == 2)
    writer = talk.one.engine.writers[talk.publisher.gid]
    (reader,) = writer.readers
    writer.readers[reader] = WINDOW_BYTES

    def go_on() -> None:
        writer.readers[reader] = 0
        writer.on_change()

    return talk, other, go_on


async def test_a_lossless_publisher_that_is_stuck_does_not_hold_up_another_of_its_topic(world: Made) -> None:
    async with world() as made:
        talk, other, go_on = await one_stuck(made, Int32)
        for number in range(5):
            talk.publisher.publish(Int32(data=number))
        await until(lambda: any(way.waiting == 5 for way in talk.one.bridge.status().routes))
        for number in range(10, 15):
            other.publish(Int32(data=number))
        assert await received(talk.subscription, 5) == [*range(10, 15)]
        go_on()
        assert await received(talk.subscription, 5) == [*range(5)]


async def test_a_lossless_publisher_that_has_filled_its_route_holds_up_no_other_of_its_topic(
    world: Made, route: str
) -> None:
    """The publisher itself waits. The bridge holds at most its buffer, and one window on the link."""
    async with world() as made:
        talk, other, go_on = await one_stuck(made, String)
        text = "x" * 10_000

        async def flood() -> None:
            for number in range(2000):
                await talk.publisher.send(String(data=f"{number} {text}"))

        flooding = asyncio.create_task(flood())
        (export,) = [one for _, one in talk.one.bridge._exports if one.gid == talk.publisher.gid]
        await until(lambda: export.is_full)
        for number in range(300):  # more than a window
            await other.send(String(data=f"{number} {text}"))
            (heard,) = await received(talk.subscription, 1)
            assert heard == f"{number} {text}"
        assert not flooding.done()
        assert export.waiting < 700
        go_on()
        assert await received(talk.subscription, 2000) == [f"{number} {text}" for number in range(2000)]
        await flooding
        assert not any(way.dropped for way in talk.one.bridge.status().routes)


async def test_a_lossless_publisher_that_the_far_side_never_reads_goes_on_after_a_while(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "PATIENCE_S", 0.3)
    async with world() as made:
        left, right, one, other = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")

        def refuse(*_: object) -> Any:
            raise BridgeError("a test")

        read, other.engine.read = other.engine.read, refuse
        publisher = await talker.create_publisher(Int32, "numbers", LOSSLESS)
        subscription = await listener.create_subscription(Int32, "numbers", LOSSLESS)
        await publisher.wait_for_subscriptions()
        for number in range(20_000):  # more than the ring and the bridge can hold
            await publisher.send(Int32(data=number))
        (route,) = one.bridge.status().routes
        await until(lambda: one.bridge.status().routes[0].taken == 20_000)
        (route,) = one.bridge.status().routes
        assert (route.sent, route.waiting, route.dropped) == (0, 0, {"not_wanted": 20_000})
        other.engine.read = read
        await until(lambda: one.bridge.status().routes[0].is_flowing)
        await publisher.send(Int32(data=-1))
        assert await received(subscription, 1) == [-1]


async def test_what_is_lost_on_the_way_or_comes_twice_is_counted(world: Made) -> None:
    async with world() as made:
        talk = await made.talk(100)
        await talk.exchange()
        (before,) = talk.other.bridge.status().routes

        def change(samples: list[Sample]) -> list[Sample]:
            kept = [one for one in samples if one.number % 5]
            return [*kept, *kept]

        talk.link.change = change
        for number in range(100):
            talk.publisher.publish(Int32(data=number))
            await asyncio.sleep(0)
        await until(lambda: talk.other.bridge.status().routes[0].sent == before.sent + 80)
        (route,) = talk.other.bridge.status().routes
        assert route.dropped["repeated"] == 80
        assert route.dropped["lost_on_the_way"] in (19, 20)
        watcher = await talk.right.node("watcher")
        async with asyncio.timeout(WAIT_S):
            while True:
                graph = await watcher.graph(statistics=True)
                (shown,) = graph.publishers_of("/numbers")
                if shown.statistics is not None and shown.statistics.dropped.get("repeated") == 80:
                    break
                await asyncio.sleep(0.05)
        heard = await received(talk.subscription, 80)
        assert len({*heard}) == 80 and talk.subscription.take() is None


async def test_a_clock_that_is_an_hour_wrong_or_set_expires_nothing(world: Made) -> None:
    async with world() as made:
        talk = await made.talk(bus.QoSProfile(10, lifespan=WAIT_S), heard=10)
        second_ns = 1_000_000_000
        wrong_ns = 3600 * second_ns
        talk.link.change = lambda samples: [
            one._replace(source_time_ns=one.source_time_ns - wrong_ns) for one in samples
        ]
        for _ in range(3):
            await talk.exchange()
        left = await talk.left.node("late")
        late = await left.create_publisher(Int32, "numbers", talk.publisher.qos)
        await late.wait_for_subscriptions()
        wrong_ns += round(2 * WAIT_S) * second_ns  # as if it had been on the way for so long
        late.publish(Int32(data=100))
        await until(lambda: any(one.dropped.get("expired") for one in talk.other.bridge.status().routes))
        for hours in (1, 2, 0):
            wrong_ns = hours * 3600 * second_ns
            talk.publisher.publish(Int32(data=101))
            assert await received(talk.subscription, 1) == [101]


GID = bytes(range(16))
QOS = bus.QoSProfile(10)
HASH = "RIHS01_" + "0" * 64


def endpoint(**changes: Any) -> FarEndpoint:
    fields: dict[str, Any] = {
        "kind": "publisher",
        "gid": GID,
        "node": "liar/1",
        "topic": "/t",
        "type_name": "std_msgs/msg/String",
        "type_hash": HASH,
        "qos": QOS,
    }
    return FarEndpoint(**fields | changes)


async def lie(world: Made, tell: Callable[[Any], None], reason: str, **bounds: Any) -> None:
    async with world() as made:
        left = made.site("left")
        one = await made.bridge(left, bounds=Bounds(**bounds))
        one.bridge.bus_added(FarBus("liar"))
        one.bridge.node_added(FarNode("liar/1", "liar", "node", "/"))
        tell(one.bridge)
        await until(lambda: bool(one.engine.refused))
        assert one.engine.refused[0][0] == "liar"
        assert reason in one.engine.refused[0][1]
        assert any(reason in text for text in one.bridge._said)
        assert one.bridge.status().buses == []
        node = await left.node("observer")
        await node.wait_for_graph(lambda graph: not any(one.name == "node" for one in graph.nodes))


@pytest.mark.parametrize(
    ("told", "reason"),
    [
        (endpoint(gid=b"short"), "a gid of 5 bytes"),
        (endpoint(topic="/bad name"), "an invalid topic name"),
        (endpoint(topic="t"), "an invalid topic name"),
        (endpoint(type_name="String"), "its name has three parts"),
        (endpoint(type_hash="x" * 300), "a type hash of 300 characters"),
        (endpoint(qos=bus.QoSProfile(1, durability="best_available")), "which is for subscriptions"),
        (FarNode("liar/2", "liar", "bad name", "/"), "an invalid node name"),
        (FarNode("liar/2", "liar", "node", "bad"), "an invalid node name"),
        (FarNode("liar/2", "liar", "node", "/", ("x" * 300,)), "the id of a bus"),
    ],
    ids=str,
)
async def test_lies_end_the_link(world: Made, told: Any, reason: str) -> None:
    await lie(
        world,
        lambda far: far.node_added(told) if isinstance(told, FarNode) else far.endpoint_added(told),
        reason,
    )


async def test_more_than_its_share_ends_the_link(world: Made) -> None:
    def tell(far: Any) -> None:
        for number in range(12):
            far.endpoint_added(endpoint(gid=number.to_bytes(16, "big")))

    await lie(world, tell, "more than 10 endpoints", endpoints=10)


async def test_too_many_changes_end_the_link(world: Made) -> None:
    def tell(far: Any) -> None:
        for _ in range(200):
            far.endpoint_added(endpoint())
            far.endpoint_removed(GID, "liar/1")

    await lie(world, tell, "come and go more than 10 times", endpoints=20, nodes=20, news_per_s=10)


@pytest.mark.parametrize(
    ("encoded", "reason"),
    [
        (b"", "is broken"),
        (b"\xc1", "is broken"),
        (b"\x80", "is broken"),
        (b"\x80" + bytes(300_000), "300001 bytes"),
    ],
)
async def test_a_broken_description_ends_the_link(world: Made, encoded: bytes, reason: str) -> None:
    async with world() as made:
        left = made.site("left")
        one = await made.bridge(left)

        async def find_schema(endpoint: FarEndpoint) -> bus.MessageSchema:
            return bus.MessageSchema("odd/msg/Odd", HASH, encoded)

        one.engine.find_schema = find_schema
        one.bridge.bus_added(FarBus("liar"))
        one.bridge.node_added(FarNode("liar/1", "liar", "node", "/"))
        one.bridge.endpoint_added(endpoint(type_name="odd/msg/Odd"))
        await until(lambda: bool(one.engine.refused))
        assert reason in one.engine.refused[0][1]


async def test_a_far_bus_of_the_same_id_is_refused(world: Made) -> None:
    async with world() as made:
        left, other = made.site("left"), made.site("other")
        one = await made.bridge(left)
        other.name = "left"
        two = await made.bridge(other)
        made.network.join(one.engine, two.engine)
        await until(lambda: bool(one.engine.refused or two.engine.refused))
        refused = [*one.engine.refused, *two.engine.refused]
        assert "choose another with --id" in refused[0][1]

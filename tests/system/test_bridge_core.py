"""Two buses and the messages between them, over an engine without a network."""

import asyncio
from collections.abc import Callable
from itertools import combinations
from typing import Any

import pytest

import bus
from bridging import KEPT, LATCHED, LOSSLESS, Made, received, world
from bus.endpoint.endpoint import core_of
from bus.link.link import Link
from bus.msg.std_msgs import Int32, String
from bus.names import service_of_topic
from bus.service import client_core as client_module
from bus.srv.example_interfaces import AddTwoInts
from bus.wire.messages import Observe
from bus_bridge.core.rules import TopicRule
from bus_bridge.engine import LocalEndpoint
from bus_bridge.errors import NotCarried
from conftest import WAIT_S
from semantics import until

__all__ = ["world"]


async def test_a_talker_is_heard_on_the_other_bus(world: Made) -> None:
    async with world() as made:
        talk = await made.talk(kind=String)
        await talk.is_on()
        for number in range(3):
            talk.publisher.publish(String(data=str(number)))
        assert await received(talk.subscription, 3) == ["0", "1", "2"]


async def test_the_graph_shows_the_other_bus_as_it_is(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        talker = await left.node("talker", namespace="robot")
        qos = bus.QoSProfile(7, reliability="best_effort", deadline=1.5, lifespan=2.5)
        publisher = await talker.create_publisher(String, "chatter", qos)
        subscription = await talker.create_subscription(Int32, "numbers", 3)
        hidden = await left.node("_tool")
        looker = await right.node("looker")
        graph = await looker.wait_for_graph(
            lambda graph: (
                len(graph.publishers_of("/robot/chatter")) == 1
                and len(graph.subscriptions_of("/robot/numbers")) == 1
                and any(one.full_name == hidden.full_name for one in graph.nodes)
            )
        )
        shown, heard = graph.publishers_of("/robot/chatter")[0], graph.subscriptions_of("/robot/numbers")[0]
        assert (shown.gid, shown.qos, shown.type_name) == (publisher.gid, qos, "std_msgs/msg/String")
        assert (heard.gid, heard.qos.depth) == (subscription.gid, 3)
        assert shown.node.full_name == talker.full_name
        assert shown.node.origin == bus.Origin("pair", "left")
        bridge = bus.Origin("pair", "right")
        assert {one.node.origin for one in graph.publishers_of("/rosout")} == {bridge}
        await publisher.close()
        await looker.wait_for_graph(lambda graph: not graph.publishers_of("/robot/chatter"))
        await talker.close()
        await looker.wait_for_graph(
            lambda graph: all(one.full_name != talker.full_name for one in graph.nodes)
        )


async def test_what_an_engine_does_not_carry_is_in_no_count(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with world() as made:
        left = made.site("left")
        one = await made.bridge(left)
        announce_publisher = one.engine.announce_publisher
        announce_subscription = one.engine.announce_subscription

        def refuse(announce: Callable[..., Any]) -> Callable[..., Any]:
            def announce_or_not(endpoint: LocalEndpoint, *more: Any) -> Any:
                if service_of_topic(endpoint.topic) is not None:
                    raise NotCarried("no services")
                return announce(endpoint, *more)

            return announce_or_not

        monkeypatch.setattr(one.engine, "announce_publisher", refuse(announce_publisher))
        monkeypatch.setattr(one.engine, "announce_subscription", refuse(announce_subscription))
        node = await left.node("adder")
        await node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response())
        await node.create_publisher(String, "chatter")
        await until(lambda: one.bridge.status().shown_there.publishers)
        status = one.bridge.status()
        assert (status.shown_there.publishers, status.shown_there.subscriptions) == (1, 0)
        assert [route.topic for route in status.routes] == ["/chatter"]
        assert not one.bridge._said


async def test_a_late_joiner_gets_what_each_publisher_keeps(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        for name in ("one", "other"):
            node = await left.node(name)
            publisher = await node.create_publisher(String, "map", LATCHED)
            publisher.publish(String(data="old"))
            publisher.publish(String(data=name))
        for number in range(2):
            listener = await right.node(f"listener{number}")
            subscription = await listener.create_subscription(String, "map", KEPT)
            assert sorted(await received(subscription, 2)) == ["one", "other"]


async def test_a_call_whose_answer_the_bridge_loses_ends(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "_LOOK_S", 0.01)
    held: list[bus.RequestId] = []
    async with world() as made:
        left, right, *_ = await made.pair()
        node, caller = await left.node("server"), await right.node("caller")
        server = await node.create_service(AddTwoInts, "add", on_request=lambda _, one: held.append(one))
        client = await caller.create_client(AddTwoInts, "add")
        await client.wait_for_service()
        call = asyncio.ensure_future(client.call(AddTwoInts.Request()))
        await until(lambda: held)
        await until(
            lambda: core_of(client)._calls[held[0].number].looks > 1
        )  # it has asked in vain: the call is at work
        core_of(server).at_work.clear()  # as if the answer had been sent, and lost
        with pytest.raises(bus.ServiceUnavailable, match="was lost on the way to or from another bus"):
            await call


async def test_a_service_is_called_on_the_other_bus(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        server, caller = await left.node("server"), await right.node("caller")
        await server.create_service(
            AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b)
        )
        for number in range(5):
            client = await caller.create_client(AddTwoInts, "add")
            await client.wait_for_service()
            response = await client.call(AddTwoInts.Request(a=number, b=2))
            assert response.sum == number + 2
            await client.close()


async def test_nothing_is_lost_where_both_sides_say_so(world: Made) -> None:
    async with world() as made:
        talk = await made.talk(LOSSLESS)
        await talk.is_on()
        number = 20_000

        async def publish() -> None:
            for index in range(number):
                await talk.publisher.send(Int32(data=index))

        publishing = asyncio.create_task(publish())
        assert await received(talk.subscription, number) == list(range(number))
        await publishing
        for bridge in (talk.one, talk.other):
            await until(lambda bridge=bridge: bridge.bridge.status().routes[0].sent == number)
            (route,) = bridge.bridge.status().routes
            assert (route.taken, route.waiting, route.dropped) == (number, 0, {})


async def test_what_a_publisher_says_at_once_crosses_whoever_it_is(world: Made) -> None:
    """The bridge makes the route after the publisher appears; the publisher closes after one message."""
    async with world() as made:
        left, right, *_ = await made.pair()
        listener = await right.node("listener")
        for qos in (10, LOSSLESS):
            topic = "shortly" if qos == 10 else "lossless"
            subscription = await listener.create_subscription(String, topic, qos)
            watcher = await left.node("watcher")
            await watcher.wait_for_graph(lambda graph, topic=topic: graph.subscriptions_of(f"/{topic}"))
            for number in range(5):
                async with bus.Node("once", arguments=[], socket=left.socket) as node:
                    publisher = await node.create_publisher(String, topic, qos)
                    await publisher.wait_for_subscriptions()
                    publisher.publish(String(data=str(number)))
                    await watcher.wait_for_graph(
                        lambda graph, gid=publisher.gid: any(one.gid == gid for one in graph.publishers)
                    )
                assert await received(subscription, 1) == [str(number)]
            await watcher.close()


async def test_what_is_said_while_a_publisher_is_being_made_known_crosses(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bridge has seen the publisher in the graph, and still waits for its type."""
    async with world() as made:
        left, right, one, _ = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        subscription = await listener.create_subscription(String, "chatter", 10)
        await talker.wait_for_graph(lambda graph: bool(graph.subscriptions_of("/chatter")))
        announcing, gate, asked = one.bridge._announcing, asyncio.Event(), asyncio.Event()
        learn = announcing._learn

        async def learn_late(types: set[tuple[str, str]]) -> None:
            asked.set()
            await gate.wait()
            await learn(types)

        monkeypatch.setattr(announcing, "_learn", learn_late)
        async with bus.Node("once", arguments=[], socket=left.socket) as node:
            publisher = await node.create_publisher(String, "chatter", 10)
            await publisher.wait_for_subscriptions()
            await asked.wait()
            publisher.publish(String(data="first"))
            (route,) = one.bridge._exports._routes.values()
            await until(lambda: sum(tap.statistics().delivered for tap in route.taps) == 1)
        gate.set()
        assert await received(subscription, 1) == ["first"]


async def test_what_comes_while_busd_says_nothing_for_long_crosses(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with world() as made:
        left, _, one, _ = await made.pair()
        get_schema, silences = one.node.get_schema, iter(range(10))

        async def get_schema_late(*words: str) -> bus.MessageSchema:
            for _ in silences:
                raise TimeoutError
            return await get_schema(*words)

        monkeypatch.setattr(one.node, "get_schema", get_schema_late)
        await (await left.node("talker")).create_publisher(String, "chatter")
        await until(lambda: one.bridge.status().shown_there.publishers == 1)


async def test_a_busd_that_says_nothing_for_long_at_the_beginning_ends_no_bridge(
    world: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, silences = Link.request, iter(range(3))

    async def request_late(link: Link, make: Any, kind: Any) -> Any:
        for _ in silences if isinstance(make(0), Observe) else ():
            raise TimeoutError
        return await request(link, make, kind)

    monkeypatch.setattr(Link, "request", request_late)
    async with world() as made:
        talk = await made.talk()
        async with asyncio.timeout(WAIT_S):
            await talk.is_on()
    assert not [*silences]


async def test_nothing_crosses_without_a_subscription_and_once_with_three(world: Made) -> None:
    async with world() as made:
        left, right, one, _ = await made.pair()
        (link,) = made.network.links
        talker, listener = await left.node("talker"), await right.node("listener")
        publisher = await talker.create_publisher(Int32, "numbers", 10)
        await listener.wait_for_graph(lambda graph: bool(graph.publishers_of("/numbers")))
        for number in range(10):
            publisher.publish(Int32(data=number))
        assert publisher.get_subscription_count() == 0
        assert link.crossed == 0
        subscriptions = [await listener.create_subscription(Int32, "numbers", 100) for _ in range(3)]
        await publisher.wait_for_subscriptions(3)
        await until(lambda: any(route.is_flowing for route in one.bridge.status().routes))
        for number in range(20):
            publisher.publish(Int32(data=number))
        for subscription in subscriptions:
            assert await received(subscription, 20) == list(range(20))
        assert link.crossed == 20
        for subscription in subscriptions:
            await subscription.close()
        await until(lambda: publisher.get_subscription_count() == 0)
        await until(lambda: not any(route.is_flowing for route in one.bridge.status().routes))
        publisher.publish(Int32(data=0))
        assert link.crossed == 20


async def test_what_two_other_buses_say_to_each_other_is_not_read_here(world: Made) -> None:
    """The bus in the middle shows both ends; only the bridges of these two buses carry the messages."""
    async with world() as made:
        sites = [made.site(name) for name in ("left", "middle", "right")]
        engines = [(await made.bridge(site)).engine for site in sites]
        for one, other in combinations(engines, 2):
            made.network.join(one, other)
        talker, looker, listener = [await site.node("node") for site in sites]
        publisher = await talker.create_publisher(String, "chatter")
        subscription = await listener.create_subscription(String, "chatter")
        await publisher.wait_for_subscriptions()
        await subscription.wait_for_publishers()
        graph = await looker.wait_for_graph(
            lambda graph: bool(graph.publishers_of("/chatter") and graph.subscriptions_of("/chatter"))
        )
        publisher.publish(String(data="hello"))
        assert await received(subscription, 1) == ["hello"]
        (shown,), (heard,) = graph.publishers_of("/chatter"), graph.subscriptions_of("/chatter")
        graph = await looker.graph(statistics=True)
        assert not [one for one in graph.matches if (one.publisher, one.subscription) == (shown.id, heard.id)]
        (shown,) = graph.publishers_of("/chatter")
        assert shown.statistics is not None and shown.statistics.samples == 0


async def test_a_namespace_goes_in_front_of_all_that_leaves(world: Made) -> None:
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        robot, desk = await made.bridge(left, namespace="/bot1"), await made.bridge(right)
        made.network.join(robot.engine, desk.engine)
        driver, operator = await left.node("driver"), await right.node("operator")
        await right.node("bystander")
        subscription = await driver.create_subscription(String, "cmd", 10)
        elsewhere = await driver.create_subscription(String, "other", 10)
        scan = await driver.create_publisher(String, "scan", 10)
        publisher = await operator.create_publisher(String, "/bot1/cmd", 10)
        outside = await operator.create_publisher(String, "/other", 10)
        scans = await operator.create_subscription(String, "/bot1/scan", 10)
        await publisher.wait_for_subscriptions()
        await scan.wait_for_subscriptions()
        publisher.publish(String(data="go"))
        scan.publish(String(data="wall"))
        assert await received(subscription, 1) == ["go"]
        assert await received(scans, 1) == ["wall"]
        assert (outside.get_subscription_count(), elsewhere.get_publisher_count()) == (0, 0)
        names = [one.full_name for one in (await operator.graph()).nodes]
        assert "/bot1/driver" in names
        shown = [one.full_name for one in (await driver.graph()).nodes if one.origin is not None]
        assert "/operator" in shown and "/bystander" not in shown


async def test_rules_say_what_crosses_and_in_which_direction(world: Made) -> None:
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        one = await made.bridge(
            left,
            deny=["/secret/**"],
            topics=[TopicRule(pattern="/out", direction="out"), TopicRule(pattern="/in", direction="in")],
        )
        made.network.join(one.engine, (await made.bridge(right)).engine)
        here, there = await left.node("here"), await right.node("there")
        for node in (here, there):
            for topic in ("/secret/a", "/out", "/in", "/both"):
                await node.create_publisher(String, topic, 10)
                await node.create_subscription(String, topic, 10)

        def shown(graph: bus.Graph) -> dict[str, set[str]]:
            endpoints = (*graph.publishers, *graph.subscriptions)
            far = [one for one in endpoints if one.node.origin is not None and one.node.name in "here there"]
            return {
                kind: {one.topic for one in far if one.kind == kind} for kind in ("publisher", "subscription")
            }

        await here.wait_for_graph(
            lambda graph: shown(graph) == {"publisher": {"/in", "/both"}, "subscription": {"/out", "/both"}}
        )
        await there.wait_for_graph(
            lambda graph: shown(graph) == {"publisher": {"/out", "/both"}, "subscription": {"/in", "/both"}}
        )


async def test_a_rule_bounds_the_rate(world: Made) -> None:
    async with world() as made:
        left, right = made.site("left"), made.site("right")
        one = await made.bridge(left, topics=[TopicRule(pattern="/fast", max_rate_hz=10.0)])
        made.network.join(one.engine, (await made.bridge(right)).engine)
        talker, listener = await left.node("talker"), await right.node("listener")
        schema = bus.MessageSchema.of(Int32)
        publisher = await talker.create_publisher(schema, "fast", 1000)
        subscription = await listener.create_subscription(Int32, "fast", 1000)
        await publisher.wait_for_subscriptions()
        began_ns = 1_700_000_000_000_000_000
        for number in range(200):  # at 100 Hz
            publisher.publish_encoded(
                bytes([0x91, 0xCC, number]), source_time_ns=began_ns + number * 10_000_000
            )
        assert await received(subscription, 20) == list(range(0, 200, 10))
        await until(lambda: one.bridge.status().routes[0].taken == 200)
        (route,) = one.bridge.status().routes
        assert (route.sent, route.dropped) == (20, {"rate_limit": 180})


async def test_mismatches_are_told_on_both_buses(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        heard: list[bus.events.IncompatibleQoS] = []
        told: list[bus.events.IncompatibleQoS] = []
        types: list[bus.events.IncompatibleType] = []
        await talker.create_publisher(
            String,
            "chatter",
            bus.QoSProfile(10, reliability="best_effort"),
            events=bus.PublisherEvents(incompatible_qos=told.append, incompatible_type=types.append),
        )
        await listener.create_subscription(
            String, "chatter", 10, events=bus.SubscriptionEvents(incompatible_qos=heard.append)
        )
        await until(lambda: bool(heard and told))
        assert (heard[0].node, told[0].node) == ("/talker", "/listener")
        assert heard[0].policy == told[0].policy == "RELIABILITY"
        other = await right.node("other")
        await other.create_subscription(
            Int32, "chatter", 10, events=bus.SubscriptionEvents(incompatible_type=types.append)
        )
        await until(lambda: {one.node for one in types} == {"/talker", "/other"})


async def test_the_original_is_told_by_gid_and_source_time(world: Made) -> None:
    async with world() as made:
        talk = await made.talk()
        await talk.is_on()
        hour_ago_ns = 1_700_000_000_000_000_000
        talk.publisher.publish_encoded(bytes([0x91, 7]), source_time_ns=hour_ago_ns)
        _, info = await talk.subscription.receive()
        assert (info.publisher_gid, info.source_timestamp) == (talk.publisher.gid, hour_ago_ns)


async def test_one_endpoint_that_the_engine_refuses_ends_nothing(world: Made) -> None:
    async with world() as made:
        left, right, one, _ = await made.pair()

        def refuse(endpoint: Any) -> str:
            if endpoint.topic == "/odd":
                raise RuntimeError("a fault of the engine")
            return "its type has wstring" if endpoint.topic == "/wide" else ""

        one.engine.refuses = refuse
        talker, listener = await left.node("talker"), await right.node("listener")
        for topic in ("odd", "wide"):
            await talker.create_publisher(String, topic, 10)
        publisher = await talker.create_publisher(String, "plain", 10)
        subscription = await listener.create_subscription(String, "plain", 10)
        await publisher.wait_for_subscriptions()
        publisher.publish(String(data="hi"))
        assert await received(subscription, 1) == ["hi"]
        for said in (
            "'/wide' does not cross: its type has wstring",
            "'/odd' does not cross: RuntimeError: a fault of the engine",
        ):
            await until(lambda said=said: said in one.bridge._said)


async def test_the_status_is_a_service(world: Made) -> None:
    from bus_bridge.core.status import SERVICE_TYPE, GetStatus

    async with world() as made:
        left, right, *_ = await made.pair()
        asker = await right.node("asker")
        talker = await left.node("talker")
        await talker.create_publisher(String, "chatter", 10)
        graph = await asker.wait_for_graph(lambda graph: bool(graph.publishers_of("/chatter")))
        names = [name for name, types in graph.services().items() if SERVICE_TYPE in types]
        assert names == ["/bridge_pair/get_status"]
        client = await asker.create_client(GetStatus, names[0])
        status = await client.call(GetStatus.Request())
        assert (status.engine, status.bus, status.buses) == ("pair", "right", ["left"])
        assert [(one.address, one.state) for one in status.links] == [("pair/left", "up")]
        assert status.shown_here.publishers == 1
        assert [(one.topic, one.direction, one.node) for one in status.routes] == [
            ("/chatter", "in", "/talker")
        ]

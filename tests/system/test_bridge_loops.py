"""No message goes in a circle or arrives twice, however buses are joined."""

import asyncio

import bus
from bridging import Made, Running, received, world
from bus.msg.std_msgs import Int32, String
from bus_bridge.core.rules import TopicRule
from semantics import until

__all__ = ["world"]


def read_by(bridge: Running) -> int:
    """The number of far buses that read messages of this bus's publishers on /chat."""
    writers = bridge.engine.writers.values()
    return sum(len(one.readers) for one in writers if one.local.topic == "/chat")


async def test_two_bridges_between_the_same_two_buses(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        second, third = await made.bridge(left), await made.bridge(right)
        talker, listener = await left.node("talker"), await right.node("listener")
        publisher = await talker.create_publisher(Int32, "numbers", 1000)
        subscription = await listener.create_subscription(Int32, "numbers", 1000)
        echo = await listener.create_publisher(Int32, "numbers", 1000)
        heard = await talker.create_subscription(Int32, "numbers", 1000)
        # The first link must show all four before the second one opens; otherwise the second shows some.
        for saying in (publisher, echo):
            await saying.wait_for_subscriptions(2)
        for hearing in (subscription, heard):
            await hearing.wait_for_publishers(2)
        made.network.join(second.engine, third.engine)
        for one in (second, third):  # until then they have taps, and could bring a message twice later on
            await until(
                lambda one=one: sum("is on this bus already" in text for text in one.bridge._said) == 2
            )
        for number in range(50):
            publisher.publish(Int32(data=number))
        assert await received(subscription, 50) == list(range(50))
        echo.publish(Int32(data=100))
        assert await received(subscription, 1) == [100]  # from its own bus, and no message before it
        assert await received(heard, 51) == [*range(50), 100]
        crossed = sum(link.crossed for link in made.network.links)
        assert crossed == 51
        # When the first link ends, the second takes over.
        made.network.links[0].down()
        await until(lambda: third.bridge.status().shown_here.publishers > 0)
        await publisher.wait_for_subscriptions(2)
        await until(lambda: publisher.get_subscription_count() == 2)
        await until(lambda: any(route.is_flowing for route in second.bridge.status().routes))
        publisher.publish(Int32(data=200))
        assert await received(subscription, 1) == [200]


async def test_three_buses_in_a_ring(world: Made) -> None:
    async with world() as made:
        sites = [made.site(name) for name in ("a", "b", "c")]
        bridges = [await made.bridge(site) for site in sites]
        for index in range(3):
            made.network.join(bridges[index].engine, bridges[(index + 1) % 3].engine)
        nodes = [await site.node(f"node_{site.name}") for site in sites]
        publishers = [await node.create_publisher(String, "chat", 100) for node in nodes]
        subscriptions = [await node.create_subscription(String, "chat", 100) for node in nodes]
        for publisher in publishers:
            await publisher.wait_for_subscriptions(3)
        for subscription in subscriptions:
            await subscription.wait_for_publishers(3)
        await until(lambda: [read_by(one) for one in bridges] == [2, 2, 2])
        for number in range(10):
            for publisher, site in zip(publishers, sites, strict=True):
                publisher.publish(String(data=f"{site.name}{number}"))
        expected = sorted(f"{site.name}{number}" for site in sites for number in range(10))
        for subscription in subscriptions:
            assert sorted(await received(subscription, 30)) == expected
        assert sum(link.crossed for link in made.network.links) == 60
        await asyncio.sleep(0)
        assert all(subscription.take() is None for subscription in subscriptions)


async def test_what_a_bridge_brought_in_goes_no_further(world: Made) -> None:
    async with world() as made:
        sites = [made.site(name) for name in ("a", "b", "c")]
        bridges = [await made.bridge(site) for site in sites]
        made.network.join(bridges[0].engine, bridges[1].engine)
        made.network.join(bridges[1].engine, bridges[2].engine)
        first, middle, last = [await site.node(f"node_{site.name}") for site in sites]
        publisher = await first.create_publisher(String, "chat", 10)
        subscription = await last.create_subscription(String, "chat", 10)
        between = await middle.create_subscription(String, "chat", 10)
        await publisher.wait_for_subscriptions()
        publisher.publish(String(data="hi"))
        assert await received(between, 1) == ["hi"]
        assert publisher.get_subscription_count() == 1
        assert subscription.get_publisher_count() == 0


async def test_transit_goes_on_and_never_back(world: Made) -> None:
    async with world() as made:
        sites = [made.site(name) for name in ("a", "b", "c")]
        rule = [TopicRule(pattern="/chat", transit=True)]
        bridges = [await made.bridge(site, topics=rule) for site in sites]
        made.network.join(bridges[0].engine, bridges[1].engine)
        made.network.join(bridges[1].engine, bridges[2].engine)
        nodes = [await site.node(f"node_{site.name}") for site in sites]
        publishers = [await node.create_publisher(String, "chat", 100) for node in nodes]
        subscriptions = [await node.create_subscription(String, "chat", 100) for node in nodes]
        for publisher in publishers:
            await publisher.wait_for_subscriptions(3)
        graph = await nodes[2].wait_for_graph(
            lambda graph: any(one.full_name == "/node_a" for one in graph.nodes)
        )
        origin = next(one.origin for one in graph.nodes if one.full_name == "/node_a")
        assert origin == bus.Origin("pair", "b", ("a",))
        await until(lambda: [read_by(one) for one in bridges] == [1, 4, 1])
        for number in range(10):
            for publisher, site in zip(publishers, sites, strict=True):
                publisher.publish(String(data=f"{site.name}{number}"))
        expected = sorted(f"{site.name}{number}" for site in sites for number in range(10))
        for subscription in subscriptions:
            assert sorted(await received(subscription, 30)) == expected
        assert sum(link.crossed for link in made.network.links) == 10 * 6


async def test_in_a_ring_with_transit_the_last_messages_of_a_publisher_come_once(world: Made) -> None:
    async with world() as made:
        sites = [made.site(name) for name in ("a", "b", "c")]
        rule = [TopicRule(pattern="/chat", transit=True)]
        bridges = [await made.bridge(site, topics=rule) for site in sites]
        for index in range(3):
            made.network.join(bridges[index].engine, bridges[(index + 1) % 3].engine)
        nodes = [await site.node(f"node_{site.name}") for site in sites]
        subscriptions = [await node.create_subscription(Int32, "chat", 100) for node in nodes]
        publisher = await nodes[2].create_publisher(Int32, "chat", 10)
        await publisher.wait_for_subscriptions(3)
        for subscription in subscriptions:
            await subscription.wait_for_publishers(1)
        # Both others have shown the third bus their mirror: a second path, from which no bridge reads.
        await until(lambda: len(bridges[0].engine.endpoints) == len(bridges[1].engine.endpoints) == 4)
        for number in range(30):
            publisher.publish(Int32(data=number))
        for subscription in subscriptions:
            assert await received(subscription, 30) == list(range(30))
        # One of the two learns of the end later than the other, which reads its mirror in the meantime.
        made.network.links[1].hang()
        await publisher.close()
        await until(lambda: read_by(bridges[1]) == 1)
        made.network.links[1].go_on()
        for subscription in subscriptions:
            await until(lambda one=subscription: one.get_publisher_count() == 0)
        await until(lambda: not any(bridge.bridge.status().shown_here.publishers for bridge in bridges))
        assert [subscription.take() for subscription in subscriptions] == [None] * 3

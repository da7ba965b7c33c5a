"""The `repr` of the objects that a program holds, in each of their states."""

import asyncio
import functools

import pytest

import bus
from bus.msg.std_msgs import Int32, String
from bus.srv.std_srvs import Trigger
from conftest import Daemon
from semantics import KEEP_ALL, LATCHED, node, until

__all__ = ["node"]


async def test_a_publisher_and_a_subscription(node: bus.Node) -> None:
    publisher = await node.create_publisher(String, "talk", LATCHED)
    subscription = await node.create_subscription(String, "talk", "sensor_data")
    await subscription.wait_for_publishers()
    await publisher.wait_for_subscriptions()
    what = "/talk std_msgs/msg/String"
    kept = "(keep last 5, reliable, transient local)"
    assert repr(publisher) == f"<Publisher {what} {kept} subscriptions=1 published=0>"
    kept = "(keep last 5, best effort)"
    assert repr(subscription) == f"<Subscription {what} {kept} publishers=1 delivered=0 dropped=0>"

    for _ in range(7):
        publisher.publish(String(data="x"))
    assert repr(publisher).endswith("subscriptions=1 published=7>")
    await subscription.receive()
    await until(lambda: sum(subscription.statistics().dropped.values()))
    assert "publishers=1 delivered=1 dropped=2>" in repr(subscription)

    await publisher.close()
    assert repr(publisher).startswith("<Publisher closed /talk std_msgs/msg/String (")
    await subscription.close()
    assert repr(subscription).startswith("<Subscription closed /talk std_msgs/msg/String (")
    assert repr(publisher).endswith("subscriptions=0 published=7>")


async def test_a_service_and_a_client(node: bus.Node) -> None:
    server = await node.create_service(Trigger, "reset", lambda request: Trigger.Response(success=True))
    client = await node.create_client(Trigger, "reset", KEEP_ALL)
    assert (await client.call(Trigger.Request())).success
    what = "/reset std_srvs/srv/Trigger"
    kept = "(keep last 1000, reliable)"
    assert repr(server) == f"<ServiceServer {what} {kept} clients=1 requests=1 responses=1>"
    assert repr(client) == f"<ServiceClient {what} (keep all, reliable) servers=1 requests=1 pending=0>"

    await server.close()
    await client.close()
    assert repr(server).startswith("<ServiceServer closed /reset ")
    assert repr(client).startswith("<ServiceClient closed /reset ")


async def test_a_timer(node: bus.Node) -> None:
    def tick() -> None:
        done.set()

    done = asyncio.Event()
    timer = node.create_timer(0.01, tick)
    await done.wait()
    timer.cancel()
    name = f"{test_a_timer.__name__}.<locals>.tick"
    assert repr(timer) == f"<Timer canceled {name} every 0.01 s calls={timer.calls} missed={timer.missed}>"
    assert timer.calls > 0
    timer.reset()
    assert repr(timer).startswith(f"<Timer {name} every 0.01 s ")
    wrapped = node.create_timer(1.5, functools.partial(tick))
    assert repr(wrapped) == f"<Timer {name} every 1.5 s calls=0 missed=0>"
    asyncio.get_running_loop().set_debug(True)
    watched = node.create_timer(1.5, functools.partial(tick))
    assert repr(watched) == repr(wrapped)


async def test_a_node(daemon: Daemon) -> None:
    node = bus.Node("talker", namespace="robot", arguments=[], rosout=False)
    assert repr(node) == "<Node not open /robot/talker publishers=0 subscriptions=0 timers=0>"
    async with node:
        publisher = await node.create_publisher(Int32, "a")
        await node.create_subscription(Int32, "a")
        timer = node.create_timer(1.0, print)
        assert repr(node) == "<Node /robot/talker publishers=1 subscriptions=1 timers=1>"
        await publisher.close()
        assert repr(node) == "<Node /robot/talker publishers=0 subscriptions=1 timers=1>"
    assert repr(node).startswith("<Node not open /robot/talker ")
    assert repr(timer) == "<Timer canceled print every 1 s calls=0 missed=0>"


async def test_while_busd_is_away_and_in_the_child_of_a_fork(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bus.link.connecting, "_RETRY_S", (3600.0,))
    node = bus.Node("talker", arguments=[], rosout=False)
    await node.open()
    endpoints = [await node.create_publisher(Int32, "a"), await node.create_subscription(Int32, "b")]
    daemon.stop()
    await until(lambda: not any(one._core.id for one in endpoints))
    assert [repr(one).split()[:3] for one in endpoints] == [
        ["<Publisher", "not", "connected"],
        ["<Subscription", "not", "connected"],
    ]
    assert repr(node).startswith("<Node /talker ")
    assert node._link is not None
    node._link.abandon(bus.ForkError("made before a fork"))
    assert [repr(one).split()[1:4] for one in endpoints] == [["ended", "by", "ForkError"]] * 2
    assert repr(node).startswith("<Node ended by ForkError /talker ")
    await node.close()


def test_a_logger() -> None:
    logger = bus.get_logger("two\nlines")
    assert repr(logger) == r"<Logger 'two\nlines' INFO>"
    logger.set_level("debug")
    assert repr(logger) == r"<Logger 'two\nlines' DEBUG>"
    logger.set_level("unset")


def test_what_a_script_holds(daemon: Daemon) -> None:
    with bus.connect("script", arguments=[], rosout=False) as node:
        publisher = node.create_publisher(String, "talk")
        subscription = node.create_subscription(String, "talk")
        assert repr(node) == "<BlockingNode /script publishers=1 subscriptions=1 timers=0>"
        assert repr(publisher).startswith("<BlockingPublisher /talk std_msgs/msg/String (keep last 10, ")
        assert repr(subscription).startswith("<BlockingSubscription /talk std_msgs/msg/String (")
    assert repr(node).startswith("<BlockingNode not open /script ")
    assert repr(publisher).startswith("<BlockingPublisher closed /talk ")

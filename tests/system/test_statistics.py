"""Counters with the time at which they were read, from which a program can compute rates."""

import asyncio
from time import monotonic_ns

import pytest

import bus
from semantics import Wheel, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


async def test_own_counters_are_of_now(node: bus.Node) -> None:
    publisher = await node.create_publisher(Wheel, "t", 10)
    subscription = await node.create_subscription(Wheel, "t", 10)
    for one in (publisher, subscription):
        before_ns = monotonic_ns()
        assert before_ns <= one.statistics().at_ns <= monotonic_ns()


async def test_counters_of_the_graph_make_a_rate(node: bus.Node) -> None:
    """A query between two reports gives the counters of the earlier one, with the time of that report."""
    publisher = await node.create_publisher(Wheel, "t", 100)
    subscription = await node.create_subscription(Wheel, "t", 100, lambda message: None)
    sent_ns: list[int] = []
    looks: list[tuple[int, int]] = []
    while len(sent_ns) < 150:
        publisher.publish(Wheel("w"))
        sent_ns.append(monotonic_ns())
        await asyncio.sleep(0.01)
        if len(sent_ns) % 10 == 0:
            (mine,) = (await node.graph(statistics=True)).publishers_of("/t")
            assert mine.statistics is not None
            looks.append((mine.statistics.samples, mine.statistics.at_ns))
    told = {look for look in looks if look[1]}
    assert len(told) > 1, looks
    for samples, at_ns in told:
        sent_by_then = sum(one <= at_ns for one in sent_ns)
        assert abs(samples - sent_by_then) <= 5, (samples, sent_by_then)
    assert subscription.statistics().delivered


async def test_ages_of_what_was_taken(node: bus.Node) -> None:
    """They cover every way of taking: at once in the process, and with the next report in the graph."""
    publisher = await node.create_publisher(Wheel, "t", 100)
    called = await node.create_subscription(Wheel, "t", 100, lambda message: None)
    taking = await node.create_subscription(Wheel, "t", 100)
    assert taking.statistics().age_count == 0
    began_ns = monotonic_ns()
    for _ in range(4):
        publisher.publish(Wheel("w"))
        await taking.receive()
    for one in (called, taking):
        await until(lambda one=one: one.statistics().delivered == 4)
        totals = one.statistics()
        assert totals.age_count == 4
        assert 0 < totals.age_max_ns <= totals.age_sum_ns <= 4 * totals.age_max_ns
        assert totals.age_max_ns < monotonic_ns() - began_ns
    told = 0
    async with asyncio.timeout(10):
        while told < 4:
            publisher.publish(Wheel("w"))
            await taking.receive()
            graph = await node.graph(statistics=True)
            (mine,) = [one for one in graph.subscriptions_of("/t") if one.gid == taking.gid]
            told = max(told, mine.statistics.age_count)
            await asyncio.sleep(0.01)
    assert 0 < mine.statistics.age_max_ns < 10e9


async def test_ages_grow_with_the_time_that_a_message_waits(node: bus.Node) -> None:
    publisher = await node.create_publisher(Wheel, "t", 100)
    subscription = await node.create_subscription(Wheel, "t", 100)
    sent_ns = monotonic_ns()
    for _ in range(2):
        publisher.publish(Wheel("w"))
    await subscription.receive()
    published_ns = monotonic_ns()
    await until(lambda: monotonic_ns() > published_ns + 50_000_000)
    taking_ns = monotonic_ns()
    await subscription.receive()
    totals = subscription.statistics()
    assert totals.age_count == 2
    assert taking_ns - published_ns <= totals.age_max_ns <= monotonic_ns() - sent_ns

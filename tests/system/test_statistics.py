"""Counters that say when they were counted, so that rates can be made of them."""

import asyncio
from time import monotonic_ns

import pytest

import bus
from semantics import Wheel, node

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


async def test_own_counters_are_of_now(node: bus.Node) -> None:
    publisher = await node.create_publisher(Wheel, "t", 10)
    subscription = await node.create_subscription(Wheel, "t", 10)
    for one in (publisher, subscription):
        before_ns = monotonic_ns()
        assert before_ns <= one.statistics().at_ns <= monotonic_ns()


async def test_counters_of_the_graph_make_a_rate(node: bus.Node) -> None:
    """What is asked for between two reports is not mistaken for what was counted just now."""
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

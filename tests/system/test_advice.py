"""Advice about the depth of a subscription whose program stands still for a moment, wherever it is shown.

By shared memory: by socket, the kernel's buffers hold that many short messages.
"""

import json
import re
from collections.abc import Iterator

import pytest

from bus.graph import EndpointStatistics, Graph
from cli import TALKER, bus, script, wait_for_graph
from conftest import Daemon

STALLER = """
import asyncio, time, bus
from bus.msg.std_msgs import String
async def main():
    taken = 0
    def on_message(message):
        nonlocal taken
        taken += 1
        if taken == 100:
            time.sleep(0.2)
    async with bus.Node("controller") as node:
        await node.create_subscription(String, "topic", 5, on_message)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


def counters(graph: Graph) -> EndpointStatistics:
    return next(
        (one.statistics or EndpointStatistics() for one in graph.subscriptions_of("/topic")),
        EndpointStatistics(),
    )


def stalled(graph: Graph) -> bool:
    """Whether it has lost some, and has taken most since."""
    now = counters(graph)
    return 0 < 12 * sum(now.dropped.values()) < now.expected


@pytest.fixture
def missed(daemon: Daemon) -> Iterator[int]:
    """How many messages the controller has missed in a row, while the talker goes on."""
    with script(STALLER), script(TALKER, "0.005"):
        yield counters(wait_for_graph(stalled)).most_missed


def test_topic_info(missed: int) -> None:
    needed = 5 + missed
    told = json.loads(bus("topic", "info", "-v", "/topic", "--json").out)["subscriptions"][0]
    assert (told["most_missed"], told["dropped"]) == (missed, {"replaced": missed}), "it stood still once"
    found = re.fullmatch(
        rf"depth 5 at (\d+) Hz holds (\d+) ms; the longest stall was (\d+) ms: depth {needed}", told["advice"]
    )
    assert found is not None, told["advice"]
    hz, holds_ms, stall_ms = map(int, found.groups())
    assert holds_ms == pytest.approx(5000 / hz, rel=0.05)
    assert stall_ms == pytest.approx(needed * 1000 / hz, rel=0.05)
    assert re.search(
        rf"\nExpected: \d+\nAdvice: depth 5 at .*: depth {needed}\n", bus("topic", "info", "-v", "/topic").out
    )


def test_doctor(missed: int) -> None:
    result = bus("doctor", "--live", "--exclude-packages")
    assert re.search(
        rf"\[warn\] losses: /topic: /controller has lost {missed} messages \(replaced\)\n"
        rf"       -> depth 5 at \d+ Hz holds \d+ ms; the longest stall was \d+ ms: depth {5 + missed}\n"
        r"\[ ok \] losses: \d+ subscriptions?, none lost a message in 3 s\n",
        result.out,
    ), result.out

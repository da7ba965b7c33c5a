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
    """How many messages the controller has missed in a row at least, while the talker goes on.

    On a busy machine it may stand still again, for a shorter or a longer time.
    """
    with script(STALLER), script(TALKER, "0.005"):
        yield counters(wait_for_graph(stalled)).most_missed


def test_topic_info(missed: int) -> None:
    told = json.loads(bus("topic", "info", "-v", "/topic", "--json").out)["subscriptions"][0]
    most = told["most_missed"]
    assert told["dropped"].keys() == {"replaced"}
    assert missed <= most <= told["dropped"]["replaced"]
    found = re.fullmatch(
        rf"depth 5 at (\d+) Hz holds (\d+) ms; the longest stall was (\d+) ms: depth {5 + most}",
        told["advice"],
    )
    assert found is not None, told["advice"]
    hz, holds_ms, stall_ms = map(int, found.groups())
    assert holds_ms == pytest.approx(5000 / hz, rel=0.05)
    assert stall_ms == pytest.approx((5 + most) * 1000 / hz, rel=0.05)
    out = bus("topic", "info", "-v", "/topic").out
    shown = re.search(r"\nExpected: \d+\nAdvice: depth 5 at .*: depth (\d+)\n", out)
    assert shown is not None and int(shown[1]) >= 5 + most, out


def test_doctor(missed: int) -> None:
    result = bus("doctor", "--live", "--exclude-packages")
    found = re.search(
        r"\[warn\] losses: /topic: /controller (.*) \(replaced\)\n"
        r"       -> depth 5 at \d+ Hz holds \d+ ms; the longest stall was \d+ ms: depth (\d+)\n(.*)\n",
        result.out,
    )
    assert found is not None, result.out
    said, depth, after = found.groups()
    assert int(depth) >= 5 + missed
    if lost := re.fullmatch(r"has lost (\d+) messages", said):
        assert int(lost[1]) >= missed
        assert re.fullmatch(r"\[ ok \] losses: \d+ subscriptions?, none lost a message in 3 s", after)
    else:
        assert re.fullmatch(r"loses [\d.]+ messages a second", said), said  # it stood still again

"""Missed deadlines in the C client, at both ends."""

from pathlib import Path
from time import monotonic

import pytest

import bus
import c_programs
from bus.msg.std_msgs import String
from c_programs import Peer, peer
from semantics import node

__all__ = ["node"]


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


def missed(peer: Peer) -> list[str]:
    return [line for line in peer.program.lines if line.startswith("event 10: ")]


@pytest.mark.parametrize("how", ["depth=10", "hold=1"])
async def test_a_subscription_misses_messages_after_the_first_one(
    node: bus.Node, programs: Path, tmp_path: Path, route: str, how: str
) -> None:
    """With a callback, and with messages that the program takes late."""
    publisher = await node.create_publisher(String, "/t", bus.QoSProfile(deadline=0.02))
    async with peer(programs, tmp_path, "listen", "/t", "deadline_ms=50", how) as listener:
        await publisher.wait_for_subscriptions()
        await node.wait_for_graph(lambda graph: bool(graph.subscriptions_of("/t")))
        assert missed(listener) == []
        begin_s = monotonic()
        publisher.publish(String(data="0 "))
        await listener.line("^event 10: .*; missed 2$")
        publisher.publish(String(data="1 "))
        await listener.line("^0 2 ")
        await listener.line("^event 10: .*; missed 3$")
        statistics = await listener.finish()
    text = "/t: no message was received within the deadline of 0.05 s; missed"
    assert missed(listener)[:2] == [f"event 10: {text} 1", f"event 10: {text} 2"]
    assert statistics["missed"] == len(missed(listener)) <= (monotonic() - begin_s) / 0.05


async def test_a_publisher_misses_messages_after_its_first_one(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    subscription = await node.create_subscription(String, "/t", 10)
    begin_s = monotonic()
    async with peer(programs, tmp_path, "talk", "/t", "1", "wait=1", "deadline_ms=50") as talker:
        await subscription.receive()
        await talker.line("^event 10: /t: no message was published within the deadline of 0.05 s; missed 2$")
        assert 2 <= (await talker.finish())["missed"] <= (monotonic() - begin_s) / 0.05


async def test_messages_in_time_miss_no_deadline(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """Of three programs, only the one whose messages have stopped misses deadlines."""
    silent = await node.create_publisher(String, "/silent", bus.QoSProfile(deadline=0.02))
    lively = await node.create_publisher(String, "/lively", bus.QoSProfile(deadline=0.02))
    async with peer(programs, tmp_path, "listen", "/silent", "deadline_ms=20") as listener:
        async with peer(programs, tmp_path, "listen", "/lively", "deadline_ms=60000") as other:
            await silent.wait_for_subscriptions()
            await lively.wait_for_subscriptions()
            silent.publish(String(data="0 "))
            lively.publish(String(data="0 "))
            await listener.line("; missed 3$")
            lively.publish(String(data="1 "))
            await other.line("^1 ")
            assert (await other.finish())["missed"] == 0
        async with peer(programs, tmp_path, "listen", "/silent", "deadline_ms=20") as late:
            await node.wait_for_graph(lambda graph: len(graph.matches) == 2)
            await listener.line(f"; missed {len(missed(listener)) + 5}$")
            assert (await late.finish())["missed"] == 0  # it has got no message
        await listener.finish()

"""The C client and a hostile busd: no message, run or memory makes it crash, hang or leak.

A hostile publisher harms only its own topic.
"""

import asyncio
import signal
import time
from pathlib import Path

import pytest

import bus
import c_programs
from bus import shm
from bus.base.descriptor import Descriptor
from bus.msg.std_msgs import String
from bus.wire import messages as m
from c_hostile import HostileBusd
from fake_broker import FakeBroker, FakeConnection
from feeding import frame_record
from programs import on_one_loop
from raw_peer import RawPeer, data
from raw_sharing import RawRing, create_publisher, ring, share
from semantics import node

__all__ = ["node"]

CONNECTIONS = 40
FRAMES = 60


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@on_one_loop
@pytest.mark.parametrize("seed", range(3))
async def test_nonsense_does_no_harm(programs: Path, tmp_path: Path, socket_path: Path, seed: int) -> None:
    options = (("keep_all",), ("latched", "watch"), ("depth=3", "watch"))[seed]
    busd = HostileBusd(socket_path, seed, requests=3 + ("watch" in options))
    try:
        serving = asyncio.create_task(asyncio.to_thread(busd.serve, CONNECTIONS, FRAMES))
        async with c_programs.peer(programs, tmp_path, "relay", "/t", "/back", *options) as peer:
            busd.may_begin.set()
            await serving
            peer.program.process.send_signal(signal.SIGTERM)
            assert await peer.program.end() == 0, [
                line for line in peer.program.lines if not line.startswith(("event", "publish"))
            ][-40:]
    finally:
        busd.close()
    assert busd.faults > 0
    assert sum(line.startswith("event 1: ") for line in peer.program.lines) >= CONNECTIONS - 1


async def until_reported(node: bus.Node, listener: c_programs.Peer, count: int) -> dict[str, int]:
    """Wait until busd knows that the listener has taken so many messages. Returns its losses.

    It stays connected.
    """
    while True:
        (one,) = (await node.graph(statistics=True)).subscriptions_of("/t")
        assert not [line for line in listener.events() if line.startswith("event 1: ")]
        if one.statistics is not None and one.statistics.samples == count:
            return dict(one.statistics.dropped)
        await asyncio.sleep(0.02)


@pytest.mark.parametrize("stamp_ns", [-(2**62), -(2**63)])
async def test_a_false_stamp_does_not_cut_its_listener_off(
    node: bus.Node, other: RawPeer, programs: Path, tmp_path: Path, stamp_ns: int
) -> None:
    """busd accepts no age above 2^62 - 1 ns in a report."""
    publisher = other.publisher(other.node(), "/t").id
    async with c_programs.peer(programs, tmp_path, "listen", "/t", "keep_all") as listener:
        records = frame_record(b"\x91\xa21 ", stamp_ns) * 64
        other.write(data(publisher, records, count=64))
        await until_reported(node, listener, 64)
        await listener.finish()
    assert listener.numbers == [1] * 64


def publisher_by_ring(peer: RawPeer) -> tuple[RawRing, m.Attached, Descriptor]:
    """A publisher on /t, matched by ring: its ring, the match, the doorbell of the other process."""
    share(peer)
    raw_ring = RawRing()
    create_publisher(peer, peer.node(), raw_ring.segment)
    attached = peer.expect(m.Attached)
    readers, doorbell = peer.descriptors
    readers.close()
    return raw_ring, attached, doorbell


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_false_numbers_in_a_ring_do_not_cut_its_listener_off(
    node: bus.Node, other: RawPeer, programs: Path, tmp_path: Path
) -> None:
    """The ring is left, its numbers count for nothing, and another publisher of the topic is heard."""
    words = ("listen", "/t", "depth=100")
    async with c_programs.peer(programs, tmp_path, *words) as listener:
        hostile, _, doorbell = publisher_by_ring(other)
        hostile.publish(1, b"\x91\xa21 ")
        ring(doorbell)
        await listener.line("^1 2 shm")
        hostile.set(hostile.LATEST, 2**63)
        hostile.set(hostile.OLDEST, 2**63)
        ring(doorbell)
        doorbell.close()
        await listener.line("^event 6: /t by socket: the ring is corrupt")
        publisher = await node.create_publisher(String, "/t", 10)
        await publisher.wait_for_subscriptions()
        publisher.publish(String(data="2 "))
        await listener.line("^2 ")
        assert await until_reported(node, listener, 2) == {}
        await listener.finish()


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_the_event_of_a_corrupt_ring_may_create(
    other: RawPeer, peer: RawPeer, programs: Path, tmp_path: Path
) -> None:
    """Creating reads what busd has sent: a match of the same subscription leaves its ring meanwhile."""
    words = ("listen", "/t", "create")
    async with c_programs.peer(programs, tmp_path, *words) as listener:
        hostile, _, doorbell = publisher_by_ring(other)
        sound, attached, its_doorbell = publisher_by_ring(peer.hello())
        listener.program.process.send_signal(signal.SIGSTOP)
        sound.publish(1, b"\x91\xa21 ")
        hostile.set(hostile.LATEST, 2**63)
        hostile.set(hostile.OLDEST, 2**63)
        ring(doorbell)
        refused = m.RefuseRoute(endpoint=attached.publisher, other=attached.subscription, text="by the test")
        peer.send(refused)
        peer.barrier()
        listener.program.process.send_signal(signal.SIGCONT)
        await listener.line("^event 6: /t by socket: the ring is corrupt")
        await listener.line("^created: 0")
        await listener.line("^1 2 ")
        await listener.finish()
        doorbell.close()
        its_doorbell.close()


@on_one_loop
async def test_a_busd_that_cuts_off_at_once_is_called_less_often(
    programs: Path, tmp_path: Path, socket_path: Path
) -> None:
    """Pauses of 20, 40, 80, 160 and 320 ms; beginning anew each time they would be 100 ms in all."""

    async def cut_off(broker: FakeBroker) -> float:
        begun_s = 0.0
        for _ in range(6):
            connection = await broker.accept()
            await connection.create(m.CreateNode, 1)
            await connection.create(m.CreateSubscription, 2)
            begun_s = begun_s or time.monotonic()
            await connection.close()
        return time.monotonic() - begun_s

    async with FakeBroker(socket_path) as broker:
        cutting = asyncio.create_task(cut_off(broker))
        async with c_programs.peer(programs, tmp_path, "listen", "/t"):
            assert await cutting > 0.5


@on_one_loop
async def test_long_texts_are_cut_between_characters(
    programs: Path, tmp_path: Path, socket_path: Path
) -> None:
    async def meet(broker: FakeBroker) -> FakeConnection:
        connection = await broker.accept()
        await connection.create(m.CreateNode, 1)
        await connection.create(m.CreateSubscription, 2)
        return connection

    async with FakeBroker(socket_path) as broker:
        meeting = asyncio.create_task(meet(broker))
        async with c_programs.peer(programs, tmp_path, "listen", "/t") as listener:
            text = "x" + "é" * 300
            (await meeting).send(m.Namesake(node=1, program=text, pid=5), m.Fault(text))
            texts = [await listener.line(one) for one in ("program (.*), process 5", "connection lost: (.*)")]
    assert [one[1] for one in texts] == ["x" + "é" * 199] * 2

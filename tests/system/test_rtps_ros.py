"""Our own RTPS with ROS 2's rclpy: discovery, samples both ways, long ones too, and ends."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any
from zlib import crc32

import pytest

from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.ids import FAST_DDS
from bus_bridge.rtps.policies import RELIABLE
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.running import RunningParticipant
from conftest import SOON_S, WAIT_S
from peers import peer
from ports import own_domain

DOMAIN = own_domain()
STRING, IMAGE = "std_msgs/msg/String", "sensor_msgs/msg/Image"
LONG = 900_000


def dds_type(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def cdr(text: str) -> bytes:
    body = text.encode() + b"\0"
    return b"\0\1\0\0" + len(body).to_bytes(4, "little") + body + bytes(-len(body) % 4)


class Ours:
    """A participant, what it knows of others, and what its readers got."""

    def __init__(self) -> None:
        self.far: dict[bytes, EndpointData] = {}
        self.participants: set[bytes] = set()
        self.vendors: set[bytes] = set()
        self.warnings: list[str] = []
        self.got: list[Arrived] = []
        self.running = RunningParticipant(DOMAIN, self, lambda one: one.topic.startswith("rt/t_"))

    def participant_added(self, data: ParticipantData) -> None:
        assert data.prefix not in self.participants
        self.participants.add(data.prefix)

    def participant_removed(self, prefix: bytes) -> None:
        self.participants.remove(prefix)

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        self.far[endpoint.guid] = endpoint
        self.vendors.add(vendor)

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        del self.far[endpoint.guid]

    def warn(self, text: str) -> None:
        self.warnings.append(text)

    async def until(self, holds: Callable[[], Any]) -> Any:
        """What `holds` returns, once it is true."""
        end = time.monotonic() + WAIT_S
        while not (found := holds()):
            assert time.monotonic() < end, (self.far, self.got, self.warnings)
            await asyncio.sleep(0.005)
        return found


@pytest.fixture
async def ours() -> AsyncIterator[Ours]:
    made = Ours()
    yield made
    made.running.close()
    assert made.warnings == [] and made.running.core.faulty == 0


async def _ros(distro: peer.Distro) -> peer.Peer:
    return await asyncio.to_thread(peer.ros, distro, "ros_node", None, domain=DOMAIN)


async def _ask(ros: peer.Peer, order: str, **arguments: Any) -> Any:
    return await asyncio.to_thread(ros.ask, order, **arguments)


@peer.each_distro
async def test_samples_both_ways(ours: Ours, distro: peer.Distro) -> None:
    reader = ours.running.add_reader("rt/t_up", dds_type(STRING), ours.got.append)
    writer = ours.running.add_writer("rt/t_down", dds_type(STRING))
    with await _ros(distro) as ros:
        await _ask(ros, "publish", topic="/t_up", type_name=STRING)
        await _ask(ros, "listen", topic="/t_down", type_name=STRING, depth=200)
        await ours.until(lambda: reader.matched and writer.matched)
        assert ours.vendors == {FAST_DDS}
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[0] == 1, topic="/t_up")
        texts = [f"number {number}" for number in range(100)]
        await _ask(ros, "send", topic="/t_up", data=texts[-1])
        await ours.until(lambda: ours.got)
        assert ours.got[0].payload == cdr(texts[-1])
        assert abs(ours.got[0].time_ns - time.time_ns()) < WAIT_S * 1e9
        await ours.until(lambda: ours.running.core.is_known(writer, writer.matched[0][:12]))
        for text in texts:
            ours.running.write(writer, cdr(text))
        heard = await asyncio.to_thread(ros.wait, "/t_down", 100)
        assert [one["data"] for one in heard] == texts
        await ours.until(lambda: writer.writer is not None and writer.writer.kept == 0)
        await _ask(ros, "end", topic="/t_up")
        await ours.until(lambda: not reader.matched)
    begun = time.monotonic()
    await ours.until(lambda: not ours.far)
    assert time.monotonic() - begun < SOON_S  # it has signed off: its lease would take longer


@peer.each_distro
async def test_long_samples_both_ways(ours: Ours, distro: peer.Distro) -> None:
    best = RELIABLE._replace(reliable=False)
    ours.running.add_reader("rt/t_up", dds_type(IMAGE), ours.got.append)
    seen: list[Arrived] = []
    other = ours.running.add_reader("rt/t_up", dds_type(IMAGE), seen.append, policies=best)
    writer = ours.running.add_writer("rt/t_down", dds_type(IMAGE))
    with await _ros(distro) as ros:
        await _ask(ros, "publish", topic="/t_up", type_name=IMAGE)
        await _ask(ros, "listen", topic="/t_down", type_name=IMAGE)
        await ours.until(lambda: other.matched and writer.matched)
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[0] == 2, topic="/t_up")
        for count in range(1, 6):
            await _ask(ros, "send", topic="/t_up", width=count, data={"size": LONG})
            await ours.until(lambda count=count: len(ours.got) >= count)
        pixels = bytes(number % 251 for number in range(LONG))
        assert all(one.payload is not None and pixels in one.payload for one in ours.got)
        for _ in range(5):
            ours.running.write(writer, ours.got[0].payload or b"")
        heard = await asyncio.to_thread(ros.wait, "/t_down", 5)
        assert {(one["data"]["size"], one["data"]["crc"]) for one in heard} == {(LONG, crc32(pixels))}


@peer.each_distro
async def test_our_end(ours: Ours, distro: peer.Distro) -> None:
    ours.running.add_writer("rt/t_down", dds_type(STRING))
    with await _ros(distro) as ros:
        await _ask(ros, "listen", topic="/t_down", type_name=STRING)
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[1] == 1, topic="/t_down")
        begun = time.monotonic()
        ours.running.close()
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[1] == 0, topic="/t_down")
        assert time.monotonic() - begun < SOON_S


@peer.each_distro
async def test_the_end_of_a_writer(ours: Ours, distro: peer.Distro) -> None:
    writer = ours.running.add_writer("rt/t_down", dds_type(STRING))
    with await _ros(distro) as ros:
        await _ask(ros, "listen", topic="/t_down", type_name=STRING)
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[1] == 1, topic="/t_down")
        ours.running.remove(writer)
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[1] == 0, topic="/t_down")
        ours.running.add_writer("rt/t_down", dds_type(STRING))
        await asyncio.to_thread(ros.wait_for, "matched", lambda found: found[1] == 1, topic="/t_down")

"""The engine for zenoh: two engines in one process or two, over loopback."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, LocalEndpoint, LocalNode, RouteRule
from bus_bridge.errors import BridgeError
from bus_bridge.zenoh import engine, presence
from bus_bridge.zenoh.engine import ZenohEngine
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.reading import ZenohReader
from bus_bridge.zenoh.sockets import tcp_sockets
from bus_bridge.zenoh.writing import ZenohWriter
from certificates import Certificates, make_certificates
from conftest import WAIT_S, open_descriptors
from ports import free_port

SCHEMA = MessageSchema.of(String)
GID = bytes(range(16))
NODE = LocalNode(1, "talker", "/")


@pytest.fixture(autouse=True, scope="module")
def zenoh_runtime() -> None:
    """Makes zenoh open its per-process descriptors first, so that no test seems to leak them."""

    async def meet() -> None:
        async with pair() as (one, _):
            await one.far.until(lambda: one.far.buses)

    asyncio.run(meet())


class Far:
    """A FarSide that records the far buses, nodes and endpoints, and lets a test wait for changes."""

    def __init__(self) -> None:
        self.buses: dict[str, FarBus] = {}
        self.nodes: dict[str, FarNode] = {}
        self.endpoints: dict[tuple[bytes, str], FarEndpoint] = {}
        self.reasons: list[str] = []
        self.warnings: list[str] = []
        self.news = asyncio.Event()

    def bus_added(self, bus: FarBus) -> None:
        self.buses[bus.id] = bus
        self.news.set()

    def bus_removed(self, bus_id: str, reason: str) -> None:
        del self.buses[bus_id]
        for key in [key for key, node in self.nodes.items() if node.bus == bus_id]:
            self.node_removed(key)
        self.reasons.append(reason)
        self.news.set()

    def node_added(self, node: FarNode) -> None:
        assert node.bus in self.buses
        self.nodes[node.key] = node
        self.news.set()

    def node_removed(self, key: str) -> None:
        del self.nodes[key]
        for one in [one for one in self.endpoints if one[1] == key]:
            del self.endpoints[one]
        self.news.set()

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert endpoint.node in self.nodes
        self.endpoints[endpoint.gid, endpoint.node] = endpoint
        self.news.set()

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        del self.endpoints[gid, node]
        self.news.set()

    def warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)
        self.news.set()

    async def until(self, condition: Callable[[], Any]) -> Any:
        async with asyncio.timeout(WAIT_S):
            while not (found := condition()):
                self.news.clear()
                await self.news.wait()
        return found

    async def endpoint(self, gid: bytes = GID) -> FarEndpoint:
        found: FarEndpoint = await self.until(
            lambda: next((one for one in self.endpoints.values() if one.gid == gid), None)
        )
        return found


class Side:
    def __init__(self, engine: ZenohEngine) -> None:
        self.engine = engine
        self.far = Far()


class Taken:
    """The samples that a reader has delivered."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []
        self.news = asyncio.Event()
        self.reader: ZenohReader | None = None
        self.takes = True

    def __call__(self, batch: Batch) -> None:
        self.samples += batch
        if self.reader is not None and self.takes:
            self.reader.taken(batch.payload_bytes)
        self.news.set()

    @property
    def numbers(self) -> list[int]:
        return [one.number for one in self.samples]

    async def until(self, number: int) -> None:
        async with asyncio.timeout(WAIT_S):
            while not self.samples or self.samples[-1].number < number:
                self.news.clear()
                await self.news.wait()


class Publisher:
    """A publisher of one side; it writes as fast as its writer accepts."""

    def __init__(self, side: Side, qos: QoSProfile, gid: bytes = GID, rule: RouteRule | None = None) -> None:
        side.engine.announce_node(NODE)
        self.change = asyncio.Event()
        topic = f"/chatter_{gid[0]}" if gid[0] else "/chatter"
        endpoint = LocalEndpoint("publisher", gid, NODE, topic, SCHEMA.type_name, SCHEMA.type_hash, qos)
        self.writer: ZenohWriter = side.engine.announce_publisher(
            endpoint, SCHEMA, rule or RouteRule(), self.change.set
        )
        self.number = 0

    async def wanted(self, is_wanted: bool = True) -> None:
        async with asyncio.timeout(WAIT_S):
            while self.writer.is_wanted is not is_wanted:
                self.change.clear()
                await self.change.wait()

    async def send(self, total: int, size: int = 64) -> None:
        payload, last = bytes(size), self.number + total
        async with asyncio.timeout(WAIT_S):
            while self.number < last:
                piece = range(self.number + 1, min(last, self.number + 100) + 1)
                self.change.clear()
                gone = self.writer.write(Loose([Sample(payload, number, time.time_ns()) for number in piece]))
                self.number += gone
                await (asyncio.sleep(0) if gone == len(piece) else self.change.wait())


@asynccontextmanager
async def opened(**options: tuple[ZenohOptions, str]) -> AsyncIterator[list[Side]]:
    """Open engines; closes them at the end."""
    before = open_descriptors()
    async with AsyncExitStack() as stack:
        sides = []
        for settings, bus in options.values():
            side = Side(ZenohEngine(bus, settings))
            await side.engine.open(side.far)
            stack.push_async_callback(side.engine.close)
            sides.append(side)
        yield sides
    async with asyncio.timeout(WAIT_S):  # zenoh closes QUIC's sockets a moment later
        while any("socket" in what for number, what in open_descriptors().items() if number not in before):
            await asyncio.to_thread(time.sleep, 0.01)


@asynccontextmanager
async def pair() -> AsyncIterator[tuple[Side, Side]]:
    where = f"tcp/127.0.0.1:{free_port()}"
    robot, laptop = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    async with opened(a=(robot, "robot"), b=(laptop, "laptop")) as (one, other):
        yield one, other


def read(side: Side, endpoint: FarEndpoint, taken: Taken) -> ZenohReader:
    taken.reader = side.engine.read(endpoint, SCHEMA, taken)
    return taken.reader


LOSSLESS = QoSProfile(history="keep_all")
RELIABLE = QoSProfile(1000)
BEST_EFFORT = QoSProfile(1000, reliability="best_effort")
LATCHED = QoSProfile(3, durability="transient_local")


async def test_endpoints_are_seen_as_they_are_and_go() -> None:
    async with pair() as (robot, laptop):
        publisher = Publisher(robot, LATCHED)
        endpoint = await laptop.far.endpoint()
        assert (endpoint.kind, endpoint.topic, endpoint.qos) == ("publisher", "/chatter", LATCHED)
        assert laptop.far.nodes[endpoint.node].name == "talker"
        assert await laptop.engine.find_schema(endpoint) == SCHEMA
        heard = LocalEndpoint(
            "subscription",
            GID[::-1],
            LocalNode(7, "listener", "/x"),
            "/chatter",
            SCHEMA.type_name,
            "h",
            RELIABLE,
        )
        laptop.engine.announce_node(heard.node)
        withdraw = laptop.engine.announce_subscription(heard, SCHEMA)
        assert (await robot.far.endpoint(GID[::-1])).kind == "subscription"
        withdraw()
        await robot.far.until(lambda: not robot.far.endpoints)
        publisher.writer.close()
        await laptop.far.until(lambda: not laptop.far.endpoints)
        robot.engine.withdraw_node(NODE)
        await laptop.far.until(lambda: not laptop.far.nodes)
        assert list(laptop.far.buses) == ["robot"]
        (link,) = laptop.engine.links()
        assert (link.state, link.bus) == ("up", "robot")
        (listening, came) = robot.engine.links()
        assert (listening.state, listening.text, listening.address) == ("up", "listening", link.address)
        assert (came.state, came.bus) == ("up", "laptop") and came.address.startswith("tcp/127.0.0.1:")
    assert not laptop.far.warnings and not robot.far.warnings


@pytest.mark.parametrize(
    "qos", [LOSSLESS, RELIABLE, BEST_EFFORT], ids=["lossless", "reliable", "best effort"]
)
async def test_messages_cross_while_somebody_reads(qos: QoSProfile) -> None:
    async with pair() as (robot, laptop):
        publisher, taken = Publisher(robot, qos), Taken()
        endpoint = await laptop.far.endpoint()
        assert not publisher.writer.is_wanted
        reader = read(laptop, endpoint, taken)
        await publisher.wanted()
        await publisher.send(100)
        await taken.until(100)
        assert taken.numbers == list(range(1, 101))
        reader.close()
        await publisher.wanted(False)
        again = Taken()
        read(laptop, endpoint, again)
        await publisher.wanted()
        await publisher.send(10)
        await again.until(110)
        assert again.numbers == list(range(101, 111))
        assert len(taken.samples) == 100


async def test_a_publisher_may_be_back_before_all_that_it_said_has_arrived() -> None:
    async with pair() as (robot, laptop):
        publisher, taken = Publisher(robot, RELIABLE), Taken()
        endpoint = await laptop.far.endpoint()
        reader = read(laptop, endpoint, taken)
        await publisher.wanted()
        await publisher.send(5)
        publisher.writer.close()
        again = Publisher(robot, RELIABLE)
        again.number = publisher.number
        await again.wanted()
        await again.send(5)
        await taken.until(10)
        assert taken.numbers == [*range(1, 11)]
        reader.close()
        await again.wanted(False)
        again.writer.close()
        await laptop.far.until(lambda: not laptop.far.endpoints)


@pytest.mark.parametrize("size", [64, 20_000, 70_000, 5_000_000])
async def test_nothing_is_lost_of_a_lossless_route(size: int) -> None:
    total = min(20_000, 100_000_000 // size)
    async with pair() as (robot, laptop):
        publisher, taken = Publisher(robot, LOSSLESS), Taken()
        read(laptop, await laptop.far.endpoint(), taken)
        await publisher.wanted()
        await publisher.send(total, size)
        await taken.until(total)
        assert taken.numbers == list(range(1, total + 1))
        assert {len(one.payload) for one in taken.samples} == {size}


async def test_a_lossless_route_waits_for_the_far_bus_and_others_go_on() -> None:
    async with pair() as (robot, laptop):
        slow, quick = Publisher(robot, LOSSLESS), Publisher(robot, LOSSLESS, bytes([1]) * 16)
        held, taken = Taken(), Taken()
        held.takes = False
        read(laptop, await laptop.far.endpoint(), held)
        read(laptop, await laptop.far.endpoint(bytes([1]) * 16), taken)
        await slow.wanted()
        await quick.wanted()
        sending = asyncio.create_task(slow.send(1000, 10_000))
        await quick.send(1000, 10_000)
        await taken.until(1000)
        await held.until(418)  # 4 MiB: the first span is smaller, and grows as parts arrive
        assert slow.number <= 419
        assert not sending.done() and slow.writer.write(Loose([Sample(bytes(10_000), 9999, 0)])) == 0
        assert held.reader is not None
        held.takes = True
        held.reader.taken(sum(len(one.payload) for one in held.samples))
        await sending
        await held.until(1000)
        assert held.numbers == list(range(1, 1001))


async def test_late_joiners_get_what_each_transient_local_publisher_keeps() -> None:
    async with pair() as (robot, laptop):
        publishers = [Publisher(robot, LATCHED, bytes([n]) * 16) for n in (1, 2)]
        for publisher in publishers:
            assert publisher.writer.is_wanted
            await publisher.send(5)
        for n in (1, 2):
            taken = Taken()
            read(laptop, await laptop.far.endpoint(bytes([n]) * 16), taken)
            await taken.until(5)
            assert taken.numbers == [3, 4, 5]
        await publishers[1].send(1)
        await taken.until(6)
        assert taken.numbers == [3, 4, 5, 6]


async def test_what_is_kept_may_be_large() -> None:
    async with pair() as (robot, laptop):
        publisher, taken = Publisher(robot, LATCHED), Taken()
        await publisher.send(3, 1_000_000)
        read(laptop, await laptop.far.endpoint(), taken)
        await taken.until(3)
        assert taken.numbers == [1, 2, 3] and {len(one.payload) for one in taken.samples} == {1_000_000}


async def test_two_links_between_two_buses_carry_each_message_once() -> None:
    here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    one, other = (
        ZenohOptions(listen=(here,), connect=(there,)),
        ZenohOptions(listen=(there,), connect=(here,)),
    )
    async with opened(a=(one, "robot"), b=(other, "laptop")) as (robot, laptop):
        publisher, taken = Publisher(robot, RELIABLE), Taken()
        read(laptop, await laptop.far.endpoint(), taken)
        await publisher.wanted()
        await publisher.send(500)
        await taken.until(500)
        assert taken.numbers == list(range(1, 501))


async def test_what_was_written_arrives_before_the_publisher_goes() -> None:
    for qos in (RELIABLE, BEST_EFFORT, LOSSLESS):
        async with pair() as (robot, laptop):
            publisher, taken = Publisher(robot, qos), Taken()
            read(laptop, await laptop.far.endpoint(), taken)
            await publisher.wanted()
            await publisher.send(50, 1000)
            publisher.writer.close()
            await laptop.far.until(lambda: not laptop.far.endpoints)
            assert taken.numbers == list(range(1, 51))


async def test_a_bus_that_lies_is_not_heard_again() -> None:
    async with pair() as (robot, laptop):
        publisher, taken = Publisher(robot, RELIABLE), Taken()
        read(laptop, await laptop.far.endpoint(), taken)
        await publisher.wanted()
        laptop.engine.refuse("robot", "too many nodes")
        await laptop.far.until(lambda: not laptop.far.buses)
        assert laptop.far.reasons == ["too many nodes"]
        await publisher.wanted(False)
        assert [one.text for one in laptop.engine.links() if one.state == "refused"] == ["too many nodes"]


async def test_one_that_claims_the_id_of_another_bus_does_it_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "_PATIENCE", 1)
    here = f"tcp/127.0.0.1:{free_port()}"
    listen, connect = ZenohOptions(listen=(here,)), ZenohOptions(connect=(here,))
    async with opened(a=(listen, "laptop"), b=(connect, "robot")) as (laptop, robot):
        publisher, taken = Publisher(robot, RELIABLE), Taken()
        endpoint = await laptop.far.endpoint()
        read(laptop, endpoint, taken)
        await publisher.wanted()
        await publisher.send(3)
        async with opened(c=(connect, "robot")) as (liar,):
            Publisher(liar, RELIABLE, GID[::-1])
            await liar.far.until(lambda: liar.far.buses)
            (text,) = await laptop.far.until(lambda: laptop.far.warnings)
            assert text.startswith("two buses have the id 'robot', and this bridge uses the first one")
            for run in (liar.engine._own.run, "0"):
                liar.engine._opened().token(f"@busd/3/robot/N/{run}/1/bad%00name/%2F/,")
            assert await laptop.engine.find_schema(endpoint) == SCHEMA
            await publisher.send(3)
            await taken.until(6)
            assert [one.text for one in laptop.engine.links() if one.state == "refused"] == [
                "another bus has the id 'robot', and came first"
            ]
        assert list(laptop.far.endpoints.values()) == [endpoint] and not laptop.far.reasons


async def test_a_bridge_that_starts_anew_is_found() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    robot, laptop = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    async with opened(b=(laptop, "laptop")) as (other,):
        await other.far.until(lambda: other.far.warnings)
        assert other.far.warnings == [f"--connect {where}: connection refused; still trying"]
        for _ in range(2):
            async with opened(a=(robot, "robot")) as (one,):
                publisher, taken = Publisher(one, RELIABLE), Taken()
                read(other, await other.far.endpoint(), taken)
                await publisher.wanted()
                await publisher.send(3)
                await taken.until(3)
            await other.far.until(lambda: not other.far.buses)
            assert taken.reader is not None
            taken.reader.close()


async def test_a_bridge_that_has_become_deaf_hears_again_once_a_link_has_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """zenoh was seen to deliver no more tokens if a link ended while another link to the same bus opened."""
    monkeypatch.setattr(engine, "_LOOK_S", 0.1)
    here, there = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    robot, laptop = ZenohOptions(listen=(here,)), ZenohOptions(connect=(here,), listen=(there,))
    async with opened(a=(robot, "robot"), b=(laptop, "laptop")) as (one, other):
        await other.far.until(lambda: "robot" in other.far.buses)
        watchers = other.engine._declared
        for deaf in watchers:
            deaf.undeclare()
            deaf._is_gone = False
        session, is_deaf = other.engine._opened(), asyncio.Event()
        session.do(lambda: session.call(is_deaf.set))
        await is_deaf.wait()
        one.engine.announce_node(NODE)
        async with opened(c=(ZenohOptions(connect=(there,)), "base")) as (third,):
            await third.far.until(lambda: "laptop" in third.far.buses)
            looks = asyncio.Semaphore(0)
            assert other.engine._presence is not None
            monkeypatch.setattr(other.engine._presence, "poll", lambda linked: looks.release())
            for _ in range(4):  # fleets arrive one by one: no new query for that
                await looks.acquire()
            assert not other.far.nodes
        await other.far.until(lambda: other.far.nodes)
        publisher, taken = Publisher(one, RELIABLE), Taken()
        read(other, await other.far.endpoint(), taken)
        await publisher.wanted()
        await publisher.send(3)
        await taken.until(3)
        assert taken.reader is not None
        taken.reader.close()


async def test_two_buses_of_one_id_are_named() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    listen, connect = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    async with opened(a=(listen, "robot"), b=(connect, "robot")) as (one, other):
        for side in (one, other):
            (text,) = await side.far.until(lambda side=side: side.far.warnings)  # type: ignore[misc]
            assert text.startswith("another bus has the id 'robot' too")
            assert ("refused", "robot", "another bus has the id of this one") in [
                (link.state, link.bus, link.text) for link in side.engine.links()
            ]


async def test_without_addresses_no_socket_is_opened() -> None:
    def sockets() -> set[str]:
        tables = [
            Path(f"/proc/self/net/{kind}").read_text().splitlines()[1:]
            for kind in ("tcp", "udp", "tcp6", "udp6")
        ]
        inodes = {line.split()[9] for table in tables for line in table}
        own = {*open_descriptors().values()}
        return {inode for inode in inodes if f"socket:[{inode}]" in own}

    before = sockets()
    async with opened(a=(ZenohOptions(), "robot")) as (side,):
        assert side.far.warnings == [
            "none of --listen, --connect and --router is given: no other bridge can be reached"
        ]
        assert sockets() <= before


async def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        where = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(BridgeError, match=f"can't listen on {where}: address already in use"):
            await ZenohEngine("robot", ZenohOptions(listen=(where,))).open(Far())


def secured(made: Certificates, listen: tuple[str, ...] = (), connect: tuple[str, ...] = ()) -> ZenohOptions:
    ca, certificate, key = map(str, made)
    return ZenohOptions(listen=listen, connect=connect, ca=ca, certificate=certificate, key=key)


@pytest.mark.parametrize("protocol", ["tls", "quic"])
async def test_both_sides_need_certificates_of_the_same_authority(tmp_path: Path, protocol: str) -> None:
    made = make_certificates(tmp_path, "robot", "laptop")
    stranger = make_certificates(tmp_path, "stranger", authority="other")["stranger"]
    where = f"{protocol}/127.0.0.1:{free_port()}"
    listen, connect = secured(made["robot"], listen=(where,)), secured(made["laptop"], connect=(where,))
    wrong = secured(stranger, connect=(where,))
    async with opened(a=(listen, "robot"), b=(connect, "laptop"), c=(wrong, "stranger")) as (
        robot,
        laptop,
        third,
    ):
        await robot.far.until(lambda: robot.far.buses)
        await laptop.far.until(lambda: laptop.far.buses)
        (text,) = await third.far.until(lambda: third.far.warnings)
        why = "its certificate is not valid here: unable to get local issuer certificate"
        assert text == f"--connect {where}: {why if protocol == 'tls' else 'no answer'}; still trying"
        assert list(robot.far.buses) == ["laptop"] and not third.far.buses


async def test_a_certificate_that_the_other_side_does_not_take_is_named(tmp_path: Path) -> None:
    robot = make_certificates(tmp_path, "robot")["robot"]
    stranger = make_certificates(tmp_path, "stranger", authority="other")["stranger"]._replace(ca=robot.ca)
    where = f"tls/127.0.0.1:{free_port()}"
    listen, wrong = secured(robot, listen=(where,)), secured(stranger, connect=(where,))
    async with opened(a=(listen, "robot"), b=(wrong, "stranger")) as (_, third):
        (text,) = await third.far.until(lambda: third.far.warnings)
        assert text == (
            f"--connect {where}: it does not accept --certificate {stranger.certificate}: unknown ca; "
            "still trying"
        )


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
async def test_no_socket_of_a_link_holds_up_the_thread_that_closes_it(tmp_path: Path, protocol: str) -> None:
    made = make_certificates(tmp_path, "robot", "laptop")
    where = f"{protocol}/127.0.0.1:{free_port()}"
    listen, connect = secured(made["robot"], listen=(where,)), secured(made["laptop"], connect=(where,))
    if protocol == "tcp":
        listen, connect = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    async with opened(a=(listen, "robot"), b=(connect, "laptop")) as sides:
        for side in sides:
            await side.far.until(lambda side=side: side.far.buses)
        ends = []
        for one in tcp_sockets():
            with one:
                ends.append(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER))
        assert len(ends) >= 2 and not any(ends)

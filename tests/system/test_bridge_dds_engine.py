"""The engine for DDS against plain cyclonedds."""

import asyncio
import os
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, contextmanager
from typing import Any

import msgspec
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

from cyclonedds.core import Policy, Qos
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from bridging import Running, world
from bus.endpoint.matches import Match
from bus.msg.std_msgs import String
from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema
from bus_bridge.batch import Loose, Sample
from bus_bridge.core.imports import Import
from bus_bridge.core.lateness import Lateness
from bus_bridge.dds import raw, reading
from bus_bridge.dds.cyclone import CycloneCarrier
from bus_bridge.dds.engine import DdsEngine
from bus_bridge.dds.graph import NodeEntities, decode, encode
from bus_bridge.dds.node_topic import info_type
from bus_bridge.dds.options import DdsOptions
from bus_bridge.errors import BridgeError, NotCarried
from conftest import SOON_S, WAIT_S
from peers import peer
from peers.dds import (
    BEST,
    DOMAIN,
    LATCHED,
    LOSSLESS,
    NODE,
    OPTIONS,
    STRING,
    Alone,
    Bridge,
    Far,
    cdr,
    sample_of,
    say,
    taken,
    until,
)

__all__ = ["world"]


by_cyclonedds = pytest.mark.parametrize("bridge", ["cyclonedds"], indirect=True)


def carrier_of(bridge: Bridge) -> CycloneCarrier:
    carrier = bridge.engine._carrier
    assert isinstance(carrier, CycloneCarrier)
    return carrier


class Mirror:
    """The publisher on the bus of a route in, which a subscription is matched with."""

    def __init__(self) -> None:
        self.matches = (Match("/listener", b"listener" * 2, QoSProfile(10), "shm"),)
        self.heard: list[str] = []

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool:
        self.heard += msgspec.msgpack.decode(payload)
        return True


@pytest.fixture(params=["cyclonedds", "rtps"])
async def bridge(request: pytest.FixtureRequest) -> AsyncIterator[Bridge]:
    made = Bridge(msgspec.structs.replace(OPTIONS, carrier=request.param))
    await made.open()
    yield made
    await made.close()


@pytest.fixture
def alone(bridge: Bridge) -> Iterator[Alone]:
    made = Alone()
    yield made
    made.close()


_OCTETS = make_idl_struct(
    "String_", "std_msgs::msg::dds_::String_", {"data": array[uint8, 8]}, dataclassify=False
)
"""cyclonedds sends any eight bytes as this type: those of a text of three letters, or others."""
_LATCHED = (Policy.Reliability.Reliable(0), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))


async def test_what_a_program_of_dds_says_is_heard(bridge: Bridge, alone: Alone) -> None:
    withdraw = bridge.listen("/chatter")
    writer = alone.writer("/chatter")
    reader = await bridge.read("/chatter")
    endpoint = bridge.far.find("publisher", "/chatter")
    assert endpoint is not None and endpoint.type_name == "std_msgs/msg/String"
    assert endpoint.type_hash == STRING.type_hash and endpoint.qos == QoSProfile(1000)
    assert bridge.far.names() == [f"/_dds_{alone.participant.guid.bytes[:12].hex()}"]
    say(writer, "one", "two")
    await until(lambda: bridge.heard == ["one", "two"])
    reader.close()
    withdraw()
    raw.delete(writer)
    await until(lambda: not bridge.far.endpoints and not bridge.far.nodes)


async def test_what_is_said_before_it_is_read_waits(bridge: Bridge, alone: Alone) -> None:
    bridge.listen("/chatter")
    writer = alone.writer("/chatter")
    await until(lambda: writer.get_matched_subscriptions())
    say(writer, "first")
    await bridge.read("/chatter")
    say(writer, "second")
    await until(lambda: bridge.heard == ["first", "second"])


@pytest.mark.parametrize("bridge", ["rtps"], indirect=True)
async def test_a_message_that_can_t_be_read_is_lost_once(bridge: Bridge, alone: Alone) -> None:
    """Its number is missing, too."""
    alone.topic("rt/chatter", _OCTETS)
    bridge.listen("/chatter")
    writer = alone.writer("/chatter")
    (await bridge.read("/chatter")).close()
    endpoint = bridge.far.find("publisher", "/chatter")
    assert endpoint is not None
    mirror: Any = Mirror()
    way = Import(bridge.engine, endpoint, STRING, mirror, Lateness(), bridge.far.warn)
    way.on_matched()
    say(writer, "one")
    assert raw.writer_of(writer)(b"\0\1\0\0" + 8 * b"\xff", time.time_ns()) == 0
    say(writer, "two", "six")
    await until(lambda: mirror.heard == ["one", "two", "six"])
    assert (way.taken, way.losses) == (4, {"undecodable": 1})
    way.end()


@by_cyclonedds
async def test_a_burst_before_it_is_read_comes_whole_to_a_lossless_subscription(
    bridge: Bridge, alone: Alone
) -> None:
    bridge.listen("/chatter", LOSSLESS)
    writer = alone.writer("/chatter", Policy.Reliability.Reliable(10**10), Policy.History.KeepAll)
    await until(lambda: writer.get_matched_subscriptions())
    burst = [*map(str, range(5000))]
    say(writer, *burst)
    (intake,) = carrier_of(bridge).ways._intakes["rt/chatter"]
    await until(lambda: len(intake._early) == 5000)
    way = await bridge.read("/chatter")
    await until(lambda: len(bridge.heard) >= 5000)
    say(writer, "more")
    await until(lambda: "more" in bridge.heard)
    assert bridge.heard == [*burst, "more"] and way.lost == {}


@by_cyclonedds
async def test_what_nobody_reads_is_kept_for_a_while_only(
    bridge: Bridge, alone: Alone, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_PATIENCE_S", 0.05)
    bridge.listen("/chatter", LOSSLESS)
    writer = alone.writer("/chatter")
    (intake,) = carrier_of(bridge).ways._intakes["rt/chatter"]
    put, kept = intake._early.put, []
    monkeypatch.setattr(intake._early, "put", lambda handle, one: kept.append(one) or put(handle, one))
    await until(lambda: writer.get_matched_subscriptions())
    say(writer, "early")
    await until(lambda: kept)
    await until(lambda: len(intake._early) == 0)
    await bridge.read("/chatter")
    say(writer, "in time")
    await until(lambda: bridge.heard)
    assert bridge.heard == ["in time"]


async def test_a_program_of_dds_hears(bridge: Bridge, alone: Alone) -> None:
    changes: list[bool] = []
    writer = bridge.publish("/chatter", on_change=lambda: changes.append(writer.is_wanted))
    assert not writer.is_wanted
    reader = alone.reader("/chatter")
    await until(lambda: writer.is_wanted)
    sample = sample_of("hi", 1)
    assert writer.write(Loose([sample])) == 1
    found = await until(lambda: raw.taker_of(reader)(10))
    assert [(data, info.source_timestamp) for data, info in found] == [(cdr("hi"), sample.source_time_ns)]
    raw.delete(reader)
    await until(lambda: not writer.is_wanted)
    assert changes == [True, False]
    writer.close()
    writer.close()


async def test_late_joiners_get_what_is_kept_both_ways(bridge: Bridge, alone: Alone) -> None:
    writer = bridge.publish("/map", LATCHED)
    bridge.send(writer, "old", "map")
    assert writer.write(Loose([sample_of("map", bridge.numbers)])) == 1  # repeated: it has that sample
    reader = alone.reader("/map", *_LATCHED[:2], Policy.History.KeepAll)
    got: list[str] = []
    await until(lambda: got.extend(taken(reader)) or got)
    await until(lambda: writer.is_wanted)
    bridge.send(writer, "new")  # not before: depth 1 keeps one sample for a reader that has not asked yet
    await until(lambda: got.extend(taken(reader)) or len(got) >= 2)
    assert got == ["map", "new"]

    far = alone.writer("/goal", *_LATCHED)
    say(far, "old", "goal")
    await until(lambda: bridge.far.find("publisher", "/goal"))
    bridge.listen("/goal", LATCHED)
    await bridge.read("/goal")
    await until(lambda: bridge.heard == ["goal"])
    say(far, "new")
    await until(lambda: bridge.heard == ["goal", "new"])


async def test_a_publisher_that_is_read_again_tells_nothing_twice(bridge: Bridge, alone: Alone) -> None:
    writer = alone.writer("/map", *_LATCHED)
    say(writer, "one")
    withdraw = bridge.listen("/map", LATCHED)
    reader = await bridge.read("/map")
    await until(lambda: bridge.heard == ["one"])
    reader.close()
    withdraw()
    say(writer, "two")
    bridge.listen("/map", LATCHED)
    await bridge.read("/map")
    await until(lambda: bridge.heard == ["one", "two"])
    say(writer, "three")
    await until(lambda: bridge.heard == ["one", "two", "three"])


async def test_best_available_gets_what_each_publisher_keeps(bridge: Bridge, alone: Alone) -> None:
    bridge.listen("/tf", BEST)
    latched, plain = alone.writer("/tf", *_LATCHED), Alone()
    say(latched, "kept")
    try:
        await bridge.read("/tf")
        await until(lambda: bridge.heard == ["kept"])
        other = plain.writer("/tf")
        await until(lambda: len(bridge.far.endpoints) == 2)
        endpoint = next(one for one in bridge.far.endpoints.values() if one.gid == other.guid.bytes)
        bridge.engine.read(endpoint, STRING, bridge.hear)
        await until(lambda: other.get_matched_subscriptions())
        say(other, "live")
        say(latched, "more")
        await until(lambda: sorted(bridge.heard) == ["kept", "live", "more"])
    finally:
        plain.close()
    await until(lambda: len(bridge.far.endpoints) == 1)
    say(latched, "last")
    await until(lambda: bridge.heard[-1] == "last")


async def test_history_that_comes_again_takes_no_message_from_other_publishers(
    bridge: Bridge, alone: Alone
) -> None:
    """The readers are made again. The other publisher keeps one message for a new reader."""
    bridge.listen("/map", LATCHED)
    latched, other = alone.writer("/map", *_LATCHED), Alone()
    say(latched, "kept")
    try:
        reader = await bridge.read("/map")
        await until(lambda: bridge.heard == ["kept"])
        busy = other.writer("/map", *_LATCHED)
        await until(lambda: len(bridge.far.endpoints) == 2)
        first, second = (bridge.far.endpoints[one.guid.bytes] for one in (latched, busy))
        bridge.engine.read(second, STRING, bridge.hear)
        await until(lambda: busy.get_matched_subscriptions())
        said = ["kept"]
        for turn in range(5):
            reader.close()
            reader = bridge.engine.read(first, STRING, bridge.hear, restores=True)
            said.append("kept")
            for number in range(100):
                said.append(f"{turn}-{number}")
                say(busy, said[-1])
                await asyncio.sleep(0)
            await until(lambda: len(bridge.heard) >= len(said))
        is_kept = "kept".__eq__  # it comes again at any time
        assert sorted(bridge.heard, key=is_kept) == sorted(said, key=is_kept)
    finally:
        other.close()


@by_cyclonedds
@pytest.mark.parametrize("durability", ["volatile", "transient_local"])
async def test_another_reader_takes_over_without_loss(bridge: Bridge, alone: Alone, durability: str) -> None:
    """Each subscription is withdrawn and made again while messages flow."""
    qos = QoSProfile(1000, durability=Durability(durability))
    policies: tuple[Any, ...] = (Policy.Reliability.Reliable(10**9), Policy.History.KeepLast(1000))
    if durability == "transient_local":
        policies += (Policy.Durability.TransientLocal,)
    writer = alone.writer("/chatter", *policies)
    withdraws = [bridge.listen("/chatter", qos) for _ in range(2)]
    await bridge.read("/chatter")
    await until(lambda: len(writer.get_matched_subscriptions()) == 2)
    said = []
    for turn in range(6):
        for number in range(100):
            said.append(f"{turn}-{number}")
            say(writer, said[-1])
            if number % 10 == 0:
                await asyncio.sleep(0.001)
            if number == 50:
                withdraws.pop(0)()
        profile = QoSProfile(10, reliability=Reliability.BEST_EFFORT) if turn % 2 else qos
        withdraws.append(bridge.listen("/chatter", profile))
        await until(lambda: len(writer.get_matched_subscriptions()) == 2)
    await until(lambda: len(bridge.heard) >= len(said))
    assert bridge.heard == said


async def test_nodes_of_this_bus_are_told_and_go(bridge: Bridge, alone: Alone) -> None:
    reader = alone.info_reader(16)
    writer = bridge.publish("/chatter")
    withdraw = bridge.listen("/back")
    said: list[list[NodeEntities]] = []

    def nodes() -> list[NodeEntities]:
        said.extend(decode(data)[1] for data, info in raw.taker_of(reader)(100) if info.valid_data)
        return said[-1] if said else []

    (node,) = await until(lambda: [one for one in nodes() if one.readers and one.writers])
    assert (node.namespace, node.name) == ("/robot", "busd_node")
    assert len(node.readers) == len(node.writers) == 1
    writer.close()
    withdraw()
    await until(lambda: nodes() == [NodeEntities("/robot", "busd_node")])
    bridge.engine.withdraw_node(NODE)
    await until(lambda: nodes() == [])


@contextmanager
def info_writer(alone: Alone, size: int, user_data: bytes) -> Iterator[Any]:
    topic = alone.topic("ros_discovery_info", info_type(size))
    writer = DataWriter(alone.participant, topic, Qos(*_LATCHED, Policy.Userdata(user_data)))
    yield writer
    raw.delete(writer)


async def test_humble_is_understood_and_answered(bridge: Bridge, alone: Alone) -> None:
    guid = alone.participant.guid.bytes
    chatter = alone.writer("/chatter")
    reader = alone.info_reader(24)
    with info_writer(alone, 24, b"") as writer:
        info = encode(guid, [NodeEntities("/old", "humble", (), (chatter.guid.bytes,))], 24)
        assert raw.writer_of(writer)(info, time.time_ns()) == 0
        await until(lambda: "/old/humble" in bridge.far.names())
        endpoint = await until(lambda: bridge.far.find("publisher", "/chatter"))
        assert bridge.far.nodes[endpoint.node].name == "humble" and endpoint.type_hash == STRING.type_hash
        others = await until(
            lambda: [
                d for d, i in raw.taker_of(reader)(100) if i.valid_data and guid not in d and len(d) > 60
            ]
        )
        assert decode(others[-1], 24)[1] == [NodeEntities("/robot", "busd_node")]


async def test_a_participant_says_whose_its_endpoints_are(bridge: Bridge, alone: Alone) -> None:
    guid = alone.participant.guid.bytes
    one = alone.writer("/chatter")
    with info_writer(alone, 16, b"typehash=RIHS01_91a0;") as writer:
        node = NodeEntities("/ros", "talker", (), (one.guid.bytes,))
        bad = NodeEntities("/ros", "no name", (), ())
        assert raw.writer_of(writer)(encode(guid, [node, bad]), time.time_ns()) == 0
        await until(lambda: bridge.far.names() == ["/ros/talker"])
        assert any("no name" in text for text in bridge.far.warnings)
    alone.close()
    await until(lambda: not bridge.far.nodes and not bridge.far.endpoints)


async def test_what_another_busd_has_marked_is_ignored(bridge: Bridge, alone: Alone) -> None:
    marked = Alone(b"busd=laptop-5e6f7a8b;")
    try:
        writer = bridge.publish("/chatter")
        bridge.listen("/back")
        theirs, back = marked.reader("/chatter"), marked.writer("/back")
        await until(lambda: back.get_matched_subscriptions() and theirs.get_matched_publications())
        say(back, "not for you")
        ours = alone.writer("/back")
        await bridge.read("/back")
        say(ours, "for you")
        await until(lambda: bridge.heard)
        assert bridge.heard == ["for you"] and not writer.is_wanted
        assert [one.gid for one in bridge.far.endpoints.values()] == [ours.guid.bytes]
    finally:
        marked.close()


async def test_types_that_are_not_known_are_said_once(bridge: Bridge, alone: Alone) -> None:
    unknown = make_idl_struct("Wheel_", "demo_msgs::msg::dds_::Wheel_", {"data": str}, dataclassify=False)
    asked = make_idl_struct("Ask_", "demo_msgs::srv::dds_::Ask_Request_", {"data": str}, dataclassify=False)
    one = DataWriter(alone.participant, alone.topic("rt/wheel", unknown))
    other = DataWriter(
        alone.participant, alone.topic("rt/text"), Qos(Policy.Userdata(b"typehash=RIHS01_0123456789abcdef;"))
    )
    server = DataReader(alone.participant, alone.topic("rq/askRequest", asked))
    client = DataWriter(alone.participant, alone.topic("rq/askRequest", asked))
    message = DataWriter(alone.participant, alone.topic("rr/addReply"))
    assert one and other and server and client and message
    await until(lambda: len(bridge.far.warnings) == 4)
    ask, add, wheel, text = sorted(
        bridge.far.warnings, key=lambda said: [word in said for word in ("text", "wheel", "add")]
    )
    assert "service /ask of ROS 2 is left out: demo_msgs/srv/Ask: unknown interface" in ask
    assert "'rr/addReply' of ROS 2 is left out: 'std_msgs::msg::dds_::String_' is not its type" in add
    assert "topic /wheel of ROS 2 is left out: unknown interface 'demo_msgs/msg/Wheel'" in wheel
    assert "std_msgs/msg/String is another type in ROS 2 (RIHS01_0123456789ab" in text
    assert not bridge.far.endpoints


async def test_a_type_that_a_node_of_this_bus_has_becomes_known(bridge: Bridge, alone: Alone) -> None:
    class Wheel(msgspec.Struct, array_like=True):
        __type_name__ = "demo_msgs/msg/Wheel"
        data: str = ""

    unknown = make_idl_struct("Wheel_", "demo_msgs::msg::dds_::Wheel_", {"data": str}, dataclassify=False)
    writer = DataWriter(
        alone.participant, alone.topic("rt/wheel", unknown), Qos(Policy.Reliability.Reliable(0))
    )
    await until(lambda: bridge.far.warnings)
    bridge.listen("/wheel", QoSProfile(), MessageSchema.of(Wheel))
    await bridge.read("/wheel")
    await until(lambda: writer.get_matched_subscriptions())
    say(writer, "turns")
    await until(lambda: bridge.heard == ["turns"])


async def test_a_payload_that_is_no_message_is_counted(bridge: Bridge, alone: Alone) -> None:
    reader = alone.reader("/chatter")
    writer = bridge.publish("/chatter")
    await until(lambda: writer.is_wanted)
    assert writer.write(Loose([Sample(b"\xc1", 1, 1), Sample(b"\x91\x05", 2, 1), sample_of("right", 3)])) == 3
    await until(lambda: taken(reader) == ["right"])
    assert writer.lost == {"undecodable": 2}


async def test_a_peer_that_hangs_holds_nobody_up(bridge: Bridge) -> None:
    loop = asyncio.get_running_loop()
    room = asyncio.Event()
    writer = bridge.publish("/chatter", LOSSLESS, on_change=room.set)
    with peer.cyclone(None, domain=DOMAIN) as far:
        await asyncio.to_thread(far.ask, "listen", topic="/chatter", type_name="std_msgs/msg/String", depth=0)
        await until(lambda: writer.is_wanted)
        os.kill(far.process.pid, 19)
        samples = [sample_of(f"{number} " + "x" * 50_000, number) for number in range(1, 1001)]
        begun = loop.time()
        gone = writer.write(Loose(samples))
        assert loop.time() - begun < SOON_S and 0 < gone < 1000
        os.kill(far.process.pid, 18)
        while gone < len(samples):
            room.clear()
            gone += writer.write(Loose(samples[gone:]))
            if gone < len(samples):
                await asyncio.wait_for(room.wait(), WAIT_S)
        heard = await asyncio.to_thread(far.wait, "/chatter", 1000)
        assert [int(one["data"].split()[0]) for one in heard] == list(range(1, 1001))
        assert writer.lost == {}


async def test_a_participant_that_shows_too_much_ends_nothing_of_the_others(world: Any) -> None:
    async with world() as made, AsyncExitStack() as stack:
        site = made.site("here")
        running = Running(site, DdsEngine("here", OPTIONS))
        stack.push_async_callback(running.stop)
        await running.start()
        await until(running.engine.links)
        honest, liar = Alone(), Alone()
        stack.callback(honest.close)
        stack.callback(liar.close)
        heard: list[str] = []
        node = await site.node("listener")
        for topic in ("/chatter", "/lies"):
            await node.create_subscription(String, topic, 10, lambda message: heard.append(message.data))
        chatter, lies = honest.writer("/chatter"), liar.writer("/lies")
        await until(lambda: chatter.get_matched_subscriptions() and lies.get_matched_subscriptions())
        say(lies, "true as yet")
        await until(lambda: heard == ["true as yet"])
        nodes = [NodeEntities("/liars", f"n{number}", (), ()) for number in range(1500)]
        guid = liar.participant.guid.bytes
        with info_writer(liar, 16, b"typehash=RIHS01_91a0;") as writer:
            assert raw.writer_of(writer)(encode(guid, nodes), time.time_ns()) == 0
            said = (
                f"participant {guid.hex()} of bus 'dds{DOMAIN}' is refused: its bus has more than 1000 "
                "nodes, and it has 1000 of them, more than any other"
            )
            await until(lambda: said in running.bridge._said)
            await node.wait_for_graph(lambda graph: not graph.publishers_of("/lies"))
            say(lies, "a lie")
            say(chatter, "go on")
            await until(lambda: heard[1:] == ["go on"])
            other = honest.writer("/other")
            graph = await node.wait_for_graph(lambda graph: bool(graph.publishers_of("/other")))
            assert not [one for one in graph.nodes if one.namespace == "/liars"]
            (link,) = running.engine.links()
            assert (link.state, link.text) == ("up", "1 participant, 1 refused")
        raw.delete(other)
        liar.close()
        await until(lambda: running.engine.links()[0].text == "1 participant")
        liar = Alone()
        stack.callback(liar.close)
        lies = liar.writer("/lies")
        await until(lies.get_matched_subscriptions)
        say(lies, "true again")
        await until(lambda: heard[2:] == ["true again"])


@by_cyclonedds
async def test_a_reader_that_dds_refuses_leaves_none_behind(
    bridge: Bridge, alone: Alone, monkeypatch: pytest.MonkeyPatch
) -> None:
    writers = [alone.writer("/chatter", *policies) for policies in (_LATCHED, ())]
    await until(lambda: len(bridge.far.endpoints) == len(writers))
    make, made = carrier_of(bridge).participant.make_reader, list[object]()

    def make_one(*arguments: Any) -> Any:
        if made:
            raise BridgeError("there is no room for another reader")
        made.append(make(*arguments))
        return made[0]

    monkeypatch.setattr(carrier_of(bridge).participant, "make_reader", make_one)
    with pytest.raises(BridgeError, match="no room"):
        bridge.listen("/chatter", BEST)
    assert len(made) == 1 and carrier_of(bridge).ways._intakes == {}
    assert [node.readers for node in bridge.engine._entities()] == [()]


@by_cyclonedds
async def test_a_reader_that_dds_refuses_later_is_said_and_tried_again(
    bridge: Bridge, alone: Alone, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: Any) -> Any:
        raise BridgeError("there is no room for another reader")

    writers = [alone.writer("/chatter")]
    await until(lambda: bridge.far.endpoints)
    bridge.listen("/chatter", BEST)
    with monkeypatch.context() as patched:
        patched.setattr(carrier_of(bridge).participant, "make_reader", refuse)
        writers.append(alone.writer("/chatter", *_LATCHED))
        await until(lambda: bridge.far.warnings)
    assert bridge.far.warnings == [
        "not all messages on /chatter arrive here: there is no room for another reader"
    ]
    writers.append(alone.writer("/other"))  # any discovery triggers the next attempt
    await until(lambda: len(carrier_of(bridge).ways._intakes["rt/chatter"]) == 2)


async def test_the_end_of_a_domain(bridge: Bridge, alone: Alone) -> None:
    bridge.listen("/chatter")
    writer = bridge.publish("/chatter")
    reader = alone.reader("/chatter")
    await until(lambda: bridge.far.endpoints and reader)
    assert [(link.state, link.bus, link.text) for link in bridge.engine.links()] == [
        ("up", f"dds{DOMAIN}", "1 participant")
    ]
    bridge.engine.refuse(f"dds{DOMAIN}", "it lies")
    assert not bridge.far.buses
    assert [(link.state, link.text) for link in bridge.engine.links()] == [("refused", "it lies")]
    assert writer.write(Loose([sample_of("gone")])) == 1
    writer.close()
    for announce in (bridge.publish, bridge.listen):  # so the bridge does not count it as shown
        with pytest.raises(NotCarried):
            announce("/other")


@pytest.mark.parametrize("carrier", ["cyclonedds", "rtps"])
async def test_a_domain_that_is_refused_at_once(carrier: Any) -> None:
    """Its bus has the id of this bus."""
    far, engine = Far(), DdsEngine("robot-1a2b3c4d", msgspec.structs.replace(OPTIONS, carrier=carrier))
    far.bus_added = lambda bus: engine.refuse(bus.id, "the same id")  # type: ignore[method-assign]
    far.bus_removed = lambda bus_id, reason: None  # type: ignore[method-assign]
    await engine.open(far)
    assert [(link.state, link.text) for link in engine.links()] == [("refused", "the same id")]
    await engine.close()


async def test_an_interface_that_is_not_there_is_named_once(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BridgeError, match="--interface nowhere0: there is no such network interface"):
        await DdsEngine("id", DdsOptions(3, interface="nowhere0")).open(Far())
    assert capfd.readouterr() == ("", "")  # without the lines that cyclonedds would print


async def test_a_domain_that_can_not_be_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><Nonsense/></Domain></CycloneDDS>")
    with pytest.raises(BridgeError, match="can't open DDS domain 3 as CYCLONEDDS_URI says: <CycloneDDS>"):
        await DdsEngine("id", DdsOptions(3)).open(Far())

"""Topics on our own RTPS, on a network without sockets: who waits, and which reader carries what."""

from collections.abc import Callable
from typing import Any
from unittest.mock import Mock

import msgspec
import pytest

from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.dds import rtps_topics
from bus_bridge.dds.rtps_topics import RtpsCarrier
from bus_bridge.engine import FarEndpoint, LocalEndpoint, LocalNode
from bus_bridge.ros2 import samples
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.ros2.type_names import type_to_dds
from bus_bridge.rtps.announcements import EndpointData
from bus_bridge.rtps.local import Local
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.participant import Events, Participant
from bus_bridge.rtps.policies import RELIABLE, TRANSIENT_LOCAL, Policies
from bus_bridge.rtps.reach import Reach
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.writer import Keeping
from rtps_world import GROUP, Network
from semantics import until

KNOWN = KnownType(MessageSchema.of(message_class("std_msgs/msg/String")))
TOPIC, TYPE = "rt/chatter", type_to_dds(KNOWN.codec.type_name)
LATCHED = Policies(durability=TRANSIENT_LOCAL, depth=100)
NODE = LocalNode(1, "n", "/")
ENDPOINT = LocalEndpoint("subscription", b"l" * 16, NODE, "/chatter", "", "", QoSProfile(10))


class Running:
    """A RunningParticipant on a Network."""

    def __init__(self, network: Network, events: Events, is_wanted: Callable[[EndpointData], bool]) -> None:
        self.address: Address = "10.0.0.1", 7410
        self.is_cut = False
        self._network = network
        settings = Settings(b"\1\x0f" + bytes(10), (self.address,), (GROUP,))
        self.participant = Participant(settings, self._send, events, is_wanted)
        network.machines.append(self)
        self.participant.start(network.now_ns)

    def _send(self, address: Address, datagram: bytes) -> None:
        self._network.send(self, address, datagram)

    def add_writer(self, topic: str, type_name: str, **options: Any) -> Local:
        return self.participant.add_writer(topic, type_name, self._network.now_ns, **options)

    def add_reader(
        self, topic: str, type_name: str, deliver: Callable[[Arrived], None], **options: Any
    ) -> Local:
        return self.participant.add_reader(topic, type_name, deliver, self._network.now_ns, **options)

    def write(self, local: Local, payload: bytes, *, time_ns: int) -> None:
        self.participant.write(local, payload, self._network.now_ns, time_ns)

    def remove(self, local: Local) -> None:
        self.participant.remove(local, self._network.now_ns)


class World:
    """A carrier, and a participant of ROS 2."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.network = Network()

        def run(domain: int, events: Events, is_wanted: Any, **options: object) -> Running:
            return Running(self.network, events, is_wanted)

        monkeypatch.setattr(rtps_topics, "RunningParticipant", run)
        self.carrier = RtpsCarrier(0, Reach(), {})
        self.far = self.network.add("10.0.0.2")
        self.network.run(3)
        self.heard: list[str] = []

    def far_writer(self, policies: Policies, kept: int = 1000) -> Local:
        keeping = Keeping(kept, for_late_joiners=policies.transient_local)
        now_ns = self.network.now_ns
        return self.far.participant.add_writer(TOPIC, TYPE, now_ns, policies=policies, keeping=keeping)

    def say(self, writer: Local, text: str) -> None:
        now_ns = self.network.now_ns
        cdr = samples.encode(KNOWN.codec, msgspec.msgpack.encode((text,)))
        self.far.participant.write(writer, cdr, now_ns, now_ns)

    def listen(self, policies: Policies) -> Any:
        return self.carrier.make_reader(ENDPOINT, KNOWN, policies)

    def read(self, writer: Local, *, restores: bool = False) -> Any:
        endpoint = FarEndpoint("publisher", writer.guid, "n", "/chatter", "", "", QoSProfile(10))

        def on_batch(batch: Batch) -> None:
            self.heard += [msgspec.msgpack.decode(one.payload)[0] for one in batch]

        return self.carrier.read(endpoint, 0, KNOWN, on_batch, restores=restores)


def batch(first: int, count: int) -> Batch:
    payload = msgspec.msgpack.encode(("x",))
    return Loose([Sample(payload, number, 5) for number in range(first, first + count)])


async def test_what_is_acknowledged_holds_up_no_lossless_publisher(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its samples stay for late joiners: at most so many."""
    monkeypatch.setattr(rtps_topics, "_LOSSLESS", 10)
    world = World(monkeypatch)
    got: list[bytes | None] = []
    policies = Policies(durability=TRANSIENT_LOCAL, keep_all=True)
    writer = world.carrier.make_writer(ENDPOINT, KNOWN, policies, lambda: None, lambda closed: None)
    world.far.participant.add_reader(
        TOPIC, TYPE, lambda one: got.append(one.payload), world.network.now_ns, policies=policies
    )
    world.network.run(3)
    for number in range(1, 51):
        assert writer.write(batch(number, 1)) == 1
        world.network.run(1)
    assert (len(got), writer.lost) == (50, {})
    world.far.is_cut = True
    assert writer.write(batch(51, 20)) == 10  # now it waits
    writer.close()


STRONGER = [
    (RELIABLE, RELIABLE),
    (RELIABLE, RELIABLE._replace(depth=500)),
    (RELIABLE._replace(reliable=False), RELIABLE),
    (RELIABLE._replace(reliable=False), RELIABLE._replace(reliable=False, depth=500)),
    (LATCHED, LATCHED._replace(depth=500)),
    (RELIABLE, LATCHED),
]


@pytest.mark.parametrize(("first", "second"), STRONGER)
async def test_a_new_reader_takes_no_message_away(
    monkeypatch: pytest.MonkeyPatch, first: Policies, second: Policies
) -> None:
    world = World(monkeypatch)
    writer = world.far_writer(LATCHED if second.transient_local else RELIABLE)
    one = world.listen(first)
    world.network.run(3)
    world.read(writer)
    texts = [f"{number}" for number in range(60)]
    for text in texts[:20]:
        world.say(writer, text)
    world.network.run(1)
    assert world.heard == texts[:20]
    world.listen(second)
    for text in texts[20:40]:
        world.say(writer, text)
        world.network.run(0.0005)
    world.network.run(1)
    assert world.heard == texts[:40]
    world.say(writer, texts[40])
    world.network.run(1)
    world.carrier.retire_reader(one)
    for text in texts[41:]:
        world.say(writer, text)
    world.network.run(1)
    assert world.heard == texts


async def test_a_reader_with_the_history_takes_over_if_nothing_was_passed_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch)
    writer = world.far_writer(LATCHED)
    for text in "abc":
        world.say(writer, text)
    world.network.run(1)
    world.listen(RELIABLE)
    world.network.run(3)
    world.read(writer)
    world.listen(LATCHED)
    world.network.run(3)
    assert world.heard == ["a", "b", "c"]
    world.say(writer, "d")
    world.network.run(1)
    assert world.heard == ["a", "b", "c", "d"]


RENEWED = [
    (LATCHED, LATCHED),
    (LATCHED._replace(depth=500), LATCHED),
    (LATCHED, LATCHED._replace(depth=500)),
    (RELIABLE, RELIABLE),
    (RELIABLE._replace(reliable=False), RELIABLE._replace(reliable=False)),
]


@pytest.mark.parametrize(("former", "latter"), RENEWED)
@pytest.mark.parametrize("has_other", [False, True])
async def test_a_retired_reader_carries_messages_until_the_new_one_is_known(
    monkeypatch: pytest.MonkeyPatch, former: Policies, latter: Policies, has_other: bool
) -> None:
    """The writer keeps one message, so the new reader can't get the earlier ones."""
    world = World(monkeypatch)
    writer = world.far_writer(former, kept=1)
    readers = [world.listen(former) for _ in range(2 if has_other else 1)]
    world.network.run(3)
    world.read(writer)
    texts = [f"{number}" for number in range(40)]
    for text in texts[:20]:
        world.say(writer, text)
        world.network.run(0.01)
    for reader in readers:
        world.listen(latter)
        world.carrier.retire_reader(reader)
    for text in texts[20:]:
        world.say(writer, text)
        world.network.run(0.0005)
    world.network.run(1)
    assert world.heard == texts
    await until(lambda: len(world.carrier._readers[TOPIC]) == len(readers))
    world.say(writer, "last")
    world.network.run(1)
    assert world.heard == [*texts, "last"]


async def test_the_history_comes_again_by_the_new_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also while the retired one still carries the messages of other writers."""
    world = World(monkeypatch)
    writer = world.far_writer(LATCHED)
    former = world.listen(LATCHED)
    world.network.run(3)
    route = world.read(writer)
    for text in "ab":
        world.say(writer, text)
    world.network.run(1)
    route.close()
    world.listen(LATCHED)
    world.carrier.retire_reader(former)
    world.read(writer, restores=True)
    world.say(writer, "c")
    world.network.run(1)
    assert world.heard == ["a", "b", "a", "b", "c"]


async def test_a_retired_reader_does_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rtps_topics, "_HANDOVER_S", 0.02)
    world = World(monkeypatch)
    writer = world.far_writer(LATCHED)
    former = world.listen(LATCHED)
    world.network.run(3)
    world.read(writer)
    world.far.is_cut = True
    latter = world.listen(LATCHED)
    world.carrier.retire_reader(former)
    assert world.carrier._readers[TOPIC] == [former, latter]
    await until(lambda: world.carrier._readers[TOPIC] == [latter])
    assert [*world.carrier._carrying.values()] == [latter]


async def test_messages_that_wait_for_their_route_outlive_a_retired_reader(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rtps_topics, "_HANDOVER_S", 0.02)
    world = World(monkeypatch)
    writer = world.far_writer(RELIABLE)
    former = world.listen(RELIABLE)
    world.network.run(3)
    world.say(writer, "a")
    world.network.run(1)
    latter = world.listen(RELIABLE)
    world.carrier.retire_reader(former)
    world.network.run(1)
    world.say(writer, "b")
    world.network.run(1)
    await until(lambda: world.carrier._readers[TOPIC] == [latter])
    world.say(writer, "c")
    world.network.run(1)
    world.read(writer)
    await until(lambda: len(world.heard) == 3)
    assert world.heard == ["a", "b", "c"]


async def test_a_writer_without_a_reader_is_carried_by_none(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)
    writer = world.far_writer(RELIABLE)
    reader = world.listen(RELIABLE)
    world.network.run(3)
    world.read(writer)
    assert world.carrier._carrying == {writer.guid: reader}
    world.carrier.retire_reader(reader)
    assert world.carrier._carrying == {} and not world.carrier._readers


@pytest.mark.parametrize("is_refused", [False, True])
async def test_messages_of_a_refused_participant_take_no_memory(
    monkeypatch: pytest.MonkeyPatch, is_refused: bool
) -> None:
    world = World(monkeypatch)
    world.carrier._listener = Mock(is_marked=lambda handle: is_refused)
    writer = world.far_writer(LATCHED)
    reader = world.listen(LATCHED)
    world.network.run(3)
    world.say(writer, "a")
    world.network.run(1)
    assert len(reader.early) == (not is_refused)

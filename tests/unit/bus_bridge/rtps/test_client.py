"""Clients of a Discovery Server: they find each other by it, and talk directly."""

from collections.abc import Callable

import pytest

from bus_bridge.rtps.announcements import EndpointData, ParticipantData, write_endpoint, write_participant
from bus_bridge.rtps.far import Bounds
from bus_bridge.rtps.ids import (
    FAST_DDS,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_READER,
    SPDP_WRITER,
    writer_id,
)
from bus_bridge.rtps.messages import write_data, write_gap, write_head
from bus_bridge.rtps.reader import Arrived
from rtps_server import Server
from rtps_world import Machine, Network, S

TOPIC, TYPE = "rt/chatter", "T"
LIAR = b"liar" + bytes(8)


def never(number: int) -> bool:
    return False


class World:
    """A talker and a listener, which know the servers only."""

    def __init__(self, loses: Callable[[int], bool] = never, servers: int = 1) -> None:
        self.network = Network(loses)
        self.servers = [Server(self.network, f"10.0.0.{number + 1}", number) for number in range(servers)]
        self.talker, self.listener = self.client("10.0.0.11"), self.client("10.0.0.12")
        self.got: list[bytes | None] = []
        now_ns = self.network.now_ns
        self.writer = self.talker.participant.add_writer(TOPIC, TYPE, now_ns)
        self.reader = self.listener.participant.add_reader(TOPIC, TYPE, self.deliver, now_ns)

    def client(self, host: str, bounds: Bounds = Bounds()) -> Machine:  # noqa: B008
        peers = tuple(one.address for one in self.servers)
        return self.network.add(host, bounds, peers=peers, is_client=True)

    def deliver(self, arrived: Arrived) -> None:
        self.got.append(arrived.payload)

    def say(self, payload: bytes) -> None:
        now_ns = self.network.now_ns
        self.talker.participant.write(self.writer, payload, now_ns, now_ns)


def test_they_find_each_other_and_talk() -> None:
    world = World()
    world.network.run(1)
    assert world.writer.matched == [world.reader.guid] and world.reader.matched == [world.writer.guid]
    world.servers[0].is_cut = True  # samples go directly
    world.say(b"hello")
    world.network.run(1)
    assert world.got == [b"hello"]
    assert world.servers[0].ignored == 0
    assert [len(one.participants) for one in (world.talker, world.listener)] == [2, 2]


def test_on_a_network_that_loses() -> None:
    world = World(lambda number: number % 3 == 0)
    world.network.run(20)
    sent = [bytes([number]) * 100 for number in range(1, 20)]
    for payload in sent:
        world.say(payload)
    world.network.run(20)
    assert world.got == sent


def test_a_late_client_learns_of_all() -> None:
    world = World()
    world.network.run(1)
    late = world.client("10.0.0.13")
    world.network.run(1)
    assert {one.guid for one in late.far.values()} == {world.writer.guid, world.reader.guid}


def test_an_endpoint_and_a_participant_that_end() -> None:
    world = World()
    world.network.run(1)
    world.talker.participant.remove(world.writer, world.network.now_ns)
    world.network.run(1)
    assert world.listener.far == {} and world.reader.matched == []
    world.talker.participant.leave(world.network.now_ns)
    world.network.run(1)
    assert world.listener.participants == {world.servers[0].prefix}


def test_participants_outlive_their_server_while_they_live() -> None:
    world = World()
    world.network.run(60)
    assert len(world.listener.participants) == 2  # a server tells of their end, so silence is none
    world.servers[0].is_cut = True
    world.network.run(60)
    assert world.talker.participants == {world.listener.participant.prefix}
    world.say(b"without")
    world.network.run(1)
    assert world.got == [b"without"]
    world.listener.is_cut = True
    world.network.run(30)
    assert world.talker.participants == set()
    world.servers[0].is_cut = world.listener.is_cut = False
    world.network.run(5)
    world.say(b"back")
    world.network.run(5)
    assert world.got[-1] == b"back"


def test_a_server_that_leaves_and_one_that_comes() -> None:
    world = World()
    world.network.run(1)
    world.servers[0].leave()
    world.network.run(1)
    assert world.listener.participants == {world.talker.participant.prefix}
    world.say(b"without")
    world.network.run(1)
    assert world.got == [b"without"]


def test_a_server_that_is_back_lists_the_same_participants() -> None:
    world = World()
    world.network.run(1)
    (server,) = world.servers
    server.leave()
    server.is_cut = True
    world.network.run(5)
    world.network.machines.remove(server)
    Server(world.network, "10.0.0.1")
    world.network.run(100)
    talker, listener = world.talker, world.listener
    assert talker.participants == {server.prefix, listener.participant.prefix}
    assert [one.servers for one in talker.participant.far] == [{server.prefix}, set()]
    world.say(b"on")
    world.network.run(1)
    assert world.got == [b"on"]


def test_a_server_that_restarts_at_once() -> None:
    """It counts anew, with the GUID that it had before. Clients of Fast DDS wait for the end of its lease."""
    world = World()
    gone = [world.client(f"10.0.0.{number}") for number in range(20, 24)]  # so its numbers are high
    world.network.run(30)
    for one in gone:
        world.network.machines.remove(one)
    world.network.machines.remove(world.servers[0])
    Server(world.network, "10.0.0.1")
    world.network.run(10)
    late = world.client("10.0.0.13")
    world.network.run(60)
    assert {one.guid for one in late.far.values()} == {world.writer.guid, world.reader.guid}
    assert [len(one.participants) for one in (world.talker, world.listener, late)] == [3, 3, 3]
    world.say(b"on")
    world.network.run(1)
    assert world.got == [b"on"]
    assert all(one.servers for one in world.talker.participant.far if not one.data.is_server)


def test_a_reader_without_writers_outlives_the_server() -> None:
    """The talker has nothing that could be acknowledged but its heartbeats."""
    world = World()
    world.network.run(1)
    world.servers[0].is_cut = True
    world.network.run(100)
    assert world.listener.participants == {world.talker.participant.prefix}
    assert world.reader.matched == [world.writer.guid]


def test_participants_that_can_not_be_asked_stay_until_a_server_is_back() -> None:
    world = World()
    world.network.run(1)
    late = world.client("10.0.0.13")
    world.network.run(1)
    (server,) = world.servers
    server.is_cut = True
    world.network.run(100)
    assert world.talker.participants == {world.listener.participant.prefix, late.participant.prefix}
    assert "no Discovery Server answers: no other participants can be found" in world.talker.warnings
    world.network.machines.remove(server)
    world.network.machines.remove(late)
    Server(world.network, "10.0.0.1")
    world.network.run(60)
    assert world.talker.participants == {server.prefix, world.listener.participant.prefix}


def test_an_endpoint_that_ends_while_there_is_no_server() -> None:
    world = World()
    world.network.run(1)
    (server,) = world.servers
    server.is_cut = True
    world.network.run(30)
    world.network.machines.remove(server)
    now_ns = world.network.now_ns
    world.listener.participant.remove(world.reader, now_ns)
    kept = world.listener.participant.add_reader("rt/kept", TYPE, world.deliver, now_ns)
    Server(world.network, "10.0.0.1")
    world.network.run(60)
    assert set(world.talker.far) == {kept.guid} and world.writer.matched == []


def test_of_two_servers_one_is_enough() -> None:
    world = World(servers=2)
    world.network.run(1)
    assert len(world.listener.participants) == 3 and world.got == []
    world.servers[0].is_cut = True
    world.network.run(60)
    assert world.listener.participants == {world.servers[1].prefix, world.talker.participant.prefix}
    world.say(b"hello")
    world.network.run(1)
    assert world.got == [b"hello"]
    world.talker.participant.leave(world.network.now_ns)
    world.network.run(1)
    assert world.listener.participants == {world.servers[1].prefix}


# --- hostile ones


class Hostile:
    """A client, and datagrams with any source and prefix."""

    def __init__(self, bounds: Bounds = Bounds(), servers: int = 1) -> None:  # noqa: B008
        self.world = World(servers=servers)
        self.server = self.world.servers[0]
        self.machine = self.world.client("10.0.0.13", bounds)
        self.world.network.run(1)
        self.before = set(self.machine.participants)
        self.number = 100

    def say(self, data: bytes, prefix: bytes, host: str = "10.0.0.66") -> None:
        now_ns = self.world.network.now_ns
        self.machine.participant.receive(write_head(prefix, FAST_DDS) + data, (host, 7410), now_ns)

    def describe(self, prefix: bytes, role: str = "", number: int = 1) -> bytes:
        place = (("10.0.0.66", 7410),)
        data = ParticipantData(prefix, FAST_DDS, place, place, 10 * S, role=role)
        return write_data(SPDP_READER, SPDP_WRITER, number, write_participant(data))


@pytest.mark.parametrize(
    ("host", "role"), [("10.0.0.66", "SERVER"), ("10.0.0.66", ""), ("10.0.0.1", "CLIENT"), ("10.0.0.1", "")]
)
def test_only_the_chosen_servers_are_believed(host: str, role: str) -> None:
    hostile = Hostile()
    hostile.say(hostile.describe(LIAR, role), LIAR, host)
    assert hostile.machine.participants == hostile.before


def test_a_participant_in_a_list_may_not_tell_of_others() -> None:
    hostile = Hostile()
    talker = hostile.world.talker.participant
    foreign = EndpointData("writer", hostile.world.listener.participant.prefix + writer_id(7), TOPIC, TYPE)
    data = write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, write_endpoint(foreign))
    far = dict(hostile.machine.far)
    hostile.say(data, talker.prefix)
    hostile.say(hostile.describe(LIAR), talker.prefix)
    assert hostile.machine.far == far and hostile.machine.participants == hostile.before


def test_a_server_may_not_tell_of_the_endpoints_of_others_than_those_in_its_list() -> None:
    hostile = Hostile(servers=2)
    first, second = hostile.world.servers
    far = dict(hostile.machine.far)
    for number, prefix in enumerate((first.prefix, hostile.machine.participant.prefix), 100):
        one = EndpointData("writer", prefix + writer_id(7), TOPIC, TYPE)
        gap = write_gap(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, number)
        data = write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, write_endpoint(one))
        hostile.say(gap + data, second.prefix, "10.0.0.2")
    assert hostile.machine.far == far


def test_a_server_can_not_change_another_one() -> None:
    hostile = Hostile(servers=2)
    first, second = hostile.world.servers
    gap = write_gap(SPDP_READER, SPDP_WRITER, 1, 100)
    hostile.say(gap + hostile.describe(first.prefix, number=100), second.prefix, "10.0.0.2")
    hostile.say(hostile.describe(second.prefix, number=101), second.prefix, "10.0.0.2")
    servers = {one.prefix: one for one in hostile.machine.participant.far if one.data.is_server}
    assert set(servers) == {first.prefix, second.prefix}
    assert servers[first.prefix].servers == set()


def test_an_endpoint_of_a_participant_that_another_server_has_announced() -> None:
    """It is kept until this server has announced the participant, too."""
    hostile = Hostile(servers=2)
    first, second = hostile.world.servers
    gap = write_gap(SPDP_READER, SPDP_WRITER, 1, 100)
    hostile.say(gap + hostile.describe(LIAR, number=100), first.prefix, "10.0.0.1")
    one = EndpointData("writer", LIAR + writer_id(1), TOPIC, TYPE)
    data = write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 100, write_endpoint(one))
    hostile.say(write_gap(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, 100) + data, second.prefix, "10.0.0.2")
    assert one.guid not in hostile.machine.far
    hostile.say(gap + hostile.describe(LIAR, number=100), second.prefix, "10.0.0.2")
    assert one.guid in hostile.machine.far


def test_a_server_that_answers_from_another_address_of_its_machine() -> None:
    hostile = Hostile()
    place = (("10.0.0.99", 7410), hostile.server.address)
    data = ParticipantData(LIAR, FAST_DDS, place, place, 10 * S, role="SERVER")
    hostile.say(write_data(SPDP_READER, SPDP_WRITER, 1, write_participant(data)), LIAR, "10.0.0.99")
    assert LIAR in hostile.machine.participants


def test_a_place_that_becomes_free_is_for_a_participant_that_was_refused() -> None:
    hostile = Hostile(Bounds(participants=2))
    world = hostile.world
    assert len(hostile.machine.participants) == 2
    world.talker.participant.leave(world.network.now_ns)
    world.network.run(10)
    assert hostile.machine.participants == {hostile.server.prefix, world.listener.participant.prefix}


def test_endpoints_whose_participant_never_comes_make_room() -> None:
    hostile = Hostile(Bounds(endpoints=2))
    for number in range(100, 106):
        one = EndpointData("writer", LIAR + writer_id(number), TOPIC, TYPE)
        data = write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, write_endpoint(one))
        gap = write_gap(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, number)
        hostile.say(gap + data, hostile.server.prefix, "10.0.0.1")
        hostile.world.network.run(31)
    assert not any("announces are ignored" in one for one in hostile.machine.warnings)


def test_endpoints_may_come_before_their_participant() -> None:
    hostile = Hostile(Bounds(endpoints=2))
    say = hostile.server.prefix, "10.0.0.1"
    early = [EndpointData("writer", LIAR + writer_id(number), TOPIC, TYPE) for number in range(1, 4)]
    for number, one in enumerate(early, 100):
        parts = write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, write_endpoint(one))
        hostile.say(write_gap(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, number) + parts, *say)
    assert hostile.machine.warnings == [
        "endpoints that 10.0.0.1 announces are ignored: their participants are not known"
    ]
    assert not any(guid.startswith(LIAR) for guid in hostile.machine.far)
    gap = write_gap(SPDP_READER, SPDP_WRITER, 1, 100)
    hostile.say(gap + hostile.describe(LIAR, number=100), *say)
    assert [guid for guid in hostile.machine.far if guid.startswith(LIAR)] == [one.guid for one in early[:2]]


def test_the_limit_of_participants_holds() -> None:
    hostile = Hostile(Bounds(participants=2))
    assert len(hostile.machine.participants) == 2
    assert "there are 2 participants, which is the limit" in hostile.machine.warnings[0]

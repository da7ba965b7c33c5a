"""Participants that find each other, and what they do about others that go, lie or are too many."""

import pytest

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.announcements import (
    EndpointData,
    ParticipantData,
    write_endpoint,
    write_participant,
)
from bus_bridge.rtps.far import Bounds
from bus_bridge.rtps.ids import (
    FAST_DDS,
    OUR_VENDOR,
    PARTICIPANT,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_READER,
    SPDP_WRITER,
    UNKNOWN_ENTITY,
    reader_id,
    writer_id,
)
from bus_bridge.rtps.local import Local
from bus_bridge.rtps.parameters import Address, write_parameters
from bus_bridge.rtps.policies import RELIABLE
from bus_bridge.rtps.reader import Arrived
from rows import for_each
from rtps_world import Machine, Network, S

TOPIC, TYPE = "rq/sRequest", "T"
STRANGER = b"s" * 12


class Pair:
    """Two participants, with a writer at one and a reader at the other."""

    def __init__(self, network: Network | None = None) -> None:
        self.network = network or Network()
        self.one, self.two = self.network.add("10.0.0.1"), self.network.add("10.0.0.2")
        self.got: list[bytes | None] = []
        self.writer = self.one.participant.add_writer(TOPIC, TYPE, self.network.now_ns)
        self.reader = self.listen(self.two, self.got)

    def listen(self, machine: Machine, got: list[bytes | None]) -> Local:
        def deliver(arrived: Arrived) -> None:
            got.append(arrived.payload)

        return machine.participant.add_reader(TOPIC, TYPE, deliver, self.network.now_ns)

    def write(self, payload: bytes, to: bytes | None = None) -> None:
        now_ns = self.network.now_ns
        self.one.participant.write(self.writer, payload, now_ns, now_ns, to=to)


def test_they_find_each_other_and_talk() -> None:
    pair = Pair()
    pair.network.run(1)
    assert pair.writer.matched == [pair.reader.guid] and pair.reader.matched == [pair.writer.guid]
    assert [one.topic for one in pair.two.far.values()] == [TOPIC]
    assert pair.one.participant.is_known(pair.writer, pair.two.participant.prefix)
    pair.write(b"hello")
    pair.write(bytes(5000))
    pair.network.run(1)
    assert pair.got == [b"hello", bytes(5000)]


def test_on_a_network_that_loses() -> None:
    pair = Pair(Network(lambda number: number % 3 == 0))
    pair.network.run(20)
    sent = [bytes([number]) * (100 * number) for number in range(1, 40)]
    for payload in sent:
        pair.write(payload)
        pair.network.run(0.01)
    pair.network.run(20)
    assert pair.got == sent


def test_silence_between_the_calls() -> None:
    pair = Pair()
    pair.write(b"early")
    pair.network.run(10)
    before = pair.network.sent
    pair.network.run(20)
    # Each calls the group and the other one every two seconds, and that is all.
    assert pair.network.sent - before == 2 * 2 * 10


def test_a_participant_that_is_only_called_goes_on_announcing_itself() -> None:
    # The second datagram, the first answer to the caller, is lost: Fast DDS ignores it while it starts.
    network = Network(lambda number: number == 2)
    called = network.add("10.0.0.1", peers=())
    caller = network.add("10.0.0.2", peers=(called.address,))
    network.run(1)
    assert (len(called.participants), len(caller.participants)) == (1, 0)
    network.run(1.5)
    assert len(caller.participants) == 1
    network.run(60)  # so neither lets the other's lease end
    assert (len(called.participants), len(caller.participants)) == (1, 1)


def test_announcements_are_known_only_once_they_are_acknowledged() -> None:
    pair = Pair()
    pair.network.run(1)
    pair.two.is_cut = True
    late = pair.one.participant.add_writer("rq/otherRequest", TYPE, pair.network.now_ns)
    pair.network.run(1)
    assert not pair.one.participant.is_known(late, pair.two.participant.prefix)
    pair.two.is_cut = False
    pair.network.run(3)
    assert pair.one.participant.is_known(late, pair.two.participant.prefix)
    assert not pair.one.participant.is_known(late, STRANGER)


def test_an_endpoint_that_ends() -> None:
    pair = Pair()
    pair.network.run(1)
    pair.one.participant.remove(pair.writer, pair.network.now_ns)
    pair.one.participant.remove(pair.writer, pair.network.now_ns)
    pair.network.run(1)
    assert pair.two.far == {} and pair.reader.matched == []
    late = pair.network.add("10.0.0.3")
    pair.network.run(3)
    assert [one.guid for one in late.far.values()] == [pair.reader.guid]
    pair.two.participant.remove(pair.reader, pair.network.now_ns)
    pair.network.run(1)
    assert pair.one.far == {} and late.far == {}


def test_a_participant_that_leaves() -> None:
    pair = Pair()
    pair.network.run(1)
    pair.two.participant.leave(pair.network.now_ns)
    pair.network.run(0.1)
    assert pair.one.far == {} and pair.writer.matched == []
    assert len(pair.one.participant.far) == 0


def test_a_participant_that_dies_and_comes_back() -> None:
    pair = Pair()
    pair.network.run(1)
    pair.two.is_cut = True
    pair.network.run(15)
    assert len(pair.one.participant.far) == 1
    pair.network.run(10)
    assert len(pair.one.participant.far) == 0 and pair.one.far == {} and pair.writer.matched == []
    pair.write(b"nobody gets this")
    pair.two.is_cut = False
    pair.network.run(5)
    pair.write(b"back")
    pair.network.run(1)
    assert pair.got == [b"back"]


def test_only_wanted_topics_are_kept() -> None:
    network = Network()
    one = network.add("10.0.0.1", wanted=lambda topic: topic.startswith("rq/"))
    two = network.add("10.0.0.2")
    for topic in ("rt/chatter", TOPIC):
        two.participant.add_writer(topic, TYPE, network.now_ns)
    network.run(1)
    assert [endpoint.topic for endpoint in one.far.values()] == [TOPIC]


def test_addressed_samples() -> None:
    pair = Pair()
    third = pair.network.add("10.0.0.3")
    got: list[bytes | None] = []
    reader = pair.listen(third, got)
    pair.network.run(3)
    pair.write(b"for two", pair.reader.guid)
    pair.write(b"for three", reader.guid)
    pair.write(b"for both")
    pair.network.run(1)
    assert (pair.got, got) == ([b"for two", b"for both"], [b"for three", b"for both"])


def test_samples_that_are_gathered_share_a_datagram() -> None:
    pair = Pair()
    pair.network.run(1)
    before = pair.network.sent
    pair.one.participant.gathers = True
    for number in range(5):
        pair.write(b"%d" % number)
    assert pair.network.sent == before
    pair.one.participant.flush()
    assert pair.network.sent == before + 1
    pair.write(b"alone")
    assert pair.network.sent == before + 2
    pair.network.run(1)
    assert pair.got == [b"0", b"1", b"2", b"3", b"4", b"alone"]


@pytest.mark.parametrize("count", [1, 3])
def test_many_endpoints_are_announced_in_few_datagrams(count: int) -> None:
    network = Network()
    one = network.add("10.0.0.1")
    for number in range(200):
        one.participant.add_writer(f"rq/s{number}Request", TYPE, network.now_ns)
    others = [network.add(f"10.0.0.{number + 2}") for number in range(count)]
    before = network.sent
    network.run(1)
    assert all(len(other.far) == 200 for other in others)
    assert network.sent - before < 100 * count


# --- hostile ones


class Hostile:
    """A participant, and one that says what it wants from any address."""

    def __init__(self, bounds: Bounds = Bounds()) -> None:  # noqa: B008
        self.network = Network()
        self.machine = self.network.add("10.0.0.1", bounds)
        self.number = 0

    def say(self, data: bytes, prefix: bytes = STRANGER) -> None:
        datagram = m.write_head(prefix) + data
        self.machine.participant.receive(datagram, ("10.0.0.66", 7410), self.network.now_ns)

    def join(
        self, prefix: bytes = STRANGER, lease_ns: int = 10 * S, port: int = 7410, vendor: bytes = OUR_VENDOR
    ) -> None:
        data = ParticipantData(prefix, vendor, (("10.0.0.66", port),), (), lease_ns)
        self.say(m.write_data(UNKNOWN_ENTITY, SPDP_WRITER, 1, write_participant(data)), prefix)

    def announce(self, endpoint: EndpointData | bytes) -> None:
        self.number += 1
        payload = endpoint if isinstance(endpoint, bytes) else write_endpoint(endpoint)
        self.say(m.write_data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, self.number, payload))


def endpoint(number: int, prefix: bytes = STRANGER) -> EndpointData:
    return EndpointData("writer", prefix + writer_id(number), TOPIC, TYPE, RELIABLE)


def test_a_heartbeat_for_the_reader_of_another_participant(monkeypatch: pytest.MonkeyPatch) -> None:
    hostile = Hostile()
    sent: list[tuple[Address, bytes]] = []
    monkeypatch.setattr(hostile.network, "send", lambda machine, *one: sent.append(one))
    reader, other = b"c" * 12 + reader_id(3), b"o" * 12
    hostile.join(port=7411, vendor=FAST_DDS)
    hostile.join(other)
    sent.clear()
    hostile.machine.participant.ask_for_heartbeat(reader, endpoint(1).guid)
    ((address, datagram),) = sent
    (received,) = m.read_datagram(datagram).received
    assert (address, received.source, received.destination) == (("10.0.0.66", 7411), b"c" * 12, STRANGER)
    assert isinstance(received.submessage, m.AckNack)
    assert datagram.endswith(m.write_acknack(reader_id(3), writer_id(1), 0, (), 1, is_final=False))
    for prefix in (other, b"u" * 12):  # of another vendor, and unknown
        hostile.machine.participant.ask_for_heartbeat(reader, prefix + writer_id(1))
    assert len(sent) == 1


def test_too_many_participants() -> None:
    hostile = Hostile(Bounds(participants=3))
    for number in range(5):
        hostile.join(bytes([number]) * 12)
    assert len(hostile.machine.participant.far) == 3
    assert hostile.machine.participant.far.refused == 2
    assert hostile.machine.warnings[-1] == (
        "a participant at 10.0.0.66 is ignored: there are 3 participants, which is the limit"
    )
    hostile.network.run(13)
    assert len(hostile.machine.participant.far) == 0


def test_a_lease_for_ever_ends_nevertheless() -> None:
    hostile = Hostile()
    hostile.join(lease_ns=2**62)
    hostile.network.run(290)
    assert len(hostile.machine.participant.far) == 1
    hostile.network.run(20)
    assert len(hostile.machine.participant.far) == 0


def test_too_many_endpoints() -> None:
    hostile = Hostile(Bounds(endpoints=3))
    hostile.join()
    for number in range(1, 6):
        hostile.announce(endpoint(number))
    assert len(hostile.machine.far) == 3
    (far,) = hostile.machine.participant.far
    assert far.refused_endpoints == 2
    assert "more than 3 of them" in hostile.machine.warnings[0]


def test_wrong_announcements() -> None:
    hostile = Hostile()
    hostile.say(m.write_data(UNKNOWN_ENTITY, SPDP_WRITER, 1, b"\0\3\0\0nonsense"))
    assert "a participant at 10.0.0.66 is ignored: a parameter of" in hostile.machine.warnings.pop()
    hostile.join(port=0)
    assert hostile.machine.warnings.pop().endswith("it has no address that can be reached")
    hostile.join()
    hostile.announce(b"\0\3\0\0")
    assert hostile.machine.warnings.pop() == (
        "an endpoint at 10.0.0.66 is ignored: a parameter list without its end"
    )
    hostile.announce(endpoint(1, b"o" * 12))
    assert "an endpoint of another participant" in hostile.machine.warnings.pop()
    assert hostile.machine.far == {}


def test_an_endpoint_that_changes_its_mind() -> None:
    hostile = Hostile()
    hostile.join()
    reader = hostile.machine.participant.add_reader(TOPIC, TYPE, lambda one: None, hostile.network.now_ns)
    for topic, is_matched in ((TOPIC, True), (TOPIC, True), ("rq/otherRequest", False)):
        hostile.announce(endpoint(1)._replace(topic=topic))
        assert [one.topic for one in hostile.machine.far.values()] == [topic]
        assert bool(reader.matched) is is_matched


def test_the_end_of_another_s_participant_can_t_be_told() -> None:
    hostile = Hostile()
    hostile.join()
    hostile.join(b"o" * 12)
    gone = write_parameters([(0x70, b"o" * 12 + PARTICIPANT), (0x71, b"\0\0\0\3")])
    hostile.say(m.write_data(SPDP_READER, SPDP_WRITER, 1, None, gone))
    assert [far.prefix for far in hostile.machine.participant.far] == [b"o" * 12]


def test_strangers_and_noise_are_counted() -> None:
    hostile = Hostile()
    participant = hostile.machine.participant
    hostile.say(m.write_heartbeat(PUBLICATIONS_READER, PUBLICATIONS_WRITER, 1, 1, 1, is_final=False))
    participant.receive(b"noise", ("10.0.0.66", 1), hostile.network.now_ns)
    hostile.say(b"\x15\x05\xff\xff")
    assert (participant.strange, participant.faulty) == (1, 2)


def test_samples_of_writers_that_were_not_announced_are_ignored() -> None:
    hostile = Hostile()
    hostile.join()
    got: list[Arrived] = []
    reader = hostile.machine.participant.add_reader(TOPIC, TYPE, got.append, hostile.network.now_ns)
    entity = reader.guid[12:]
    hostile.say(m.write_heartbeat(entity, writer_id(1), 1, 0, 1, is_final=True))
    hostile.say(m.write_data(entity, writer_id(1), 1, b"x"))
    assert got == []
    hostile.announce(endpoint(1))
    hostile.say(m.write_heartbeat(entity, writer_id(1), 1, 0, 1, is_final=True))
    hostile.say(m.write_data(entity, writer_id(1), 1, b"x"))
    assert [one.payload for one in got] == [b"x"]


NUMBERS_AT_THE_LIMIT = [
    [m.write_gap(UNKNOWN_ENTITY, writer_id(1), 1, 2**63 - 1, (2**63 - 1,))],
    [
        m.write_heartbeat(UNKNOWN_ENTITY, writer_id(1), 2**63 - 1, 2**63 - 1, 2, is_final=True),
        m.write_data(UNKNOWN_ENTITY, writer_id(1), 2**63 - 1, b"x"),
    ],
]


@for_each("said", NUMBERS_AT_THE_LIMIT)
def test_numbers_at_the_limit_of_64_bits_end_nothing(said: list[bytes]) -> None:
    hostile = Hostile()
    hostile.join()
    hostile.machine.participant.add_reader(TOPIC, TYPE, lambda one: None, hostile.network.now_ns)
    hostile.announce(endpoint(1))
    hostile.say(m.write_heartbeat(UNKNOWN_ENTITY, writer_id(1), 1, 3, 1, is_final=True))
    for one in said:
        hostile.say(one)
    assert hostile.machine.participant.faulty == len(said)
    before = hostile.network.sent
    hostile.network.run(5)
    assert hostile.network.sent - before > 5  # it still asks, and announces itself


def test_an_error_ends_no_plan() -> None:
    pair = Pair()
    pair.network.run(1)

    def fail(arrived: Arrived) -> None:
        raise ValueError("failed")

    reader = pair.two.participant.add_reader(TOPIC, TYPE, fail, pair.network.now_ns)
    pair.network.run(1)
    pair.write(b"x", reader.guid)
    with pytest.raises(ValueError, match="failed"):
        pair.network.run(1)
    pair.two.participant.remove(reader, pair.network.now_ns)
    pair.write(b"y")
    pair.network.run(3)
    assert pair.got == [b"y"]


def test_memory_for_samples_has_a_limit_for_each_participant() -> None:
    hostile = Hostile(Bounds(room_bytes=10_000))
    hostile.join()
    participant = hostile.machine.participant
    readers = [
        participant.add_reader(TOPIC, TYPE, lambda one: None, hostile.network.now_ns) for _ in range(20)
    ]
    hostile.announce(endpoint(1))
    for number in range(2, 200):
        hostile.say(m.write_data(UNKNOWN_ENTITY, writer_id(1), number, bytes(1000)))
    (far,) = participant.far
    assert 0 <= far.room.left < 2000
    for reader in readers:
        participant.remove(reader, hostile.network.now_ns)
    assert far.room.left == 10_000

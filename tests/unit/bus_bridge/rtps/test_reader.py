"""A reader: order, gaps, requests, and limits of what it keeps."""

from collections.abc import Sequence

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.ids import reader_id, writer_id
from bus_bridge.rtps.reader import Arrived, Reader
from bus_bridge.rtps.room import ITEM_BYTES, Room

MS = 1_000_000
ENTITY = reader_id(1)
ONE, TWO = b"1" * 12 + writer_id(1), b"2" * 12 + writer_id(1)


class World:
    """A reader, its samples, and what it has asked for since the last look."""

    def __init__(self, room_bytes: int = 100_000, *, reliable: bool = True, sample_bytes: int = 1000) -> None:
        self.sent: list[str] = []
        self.raw_bases: list[int] = []
        """The bases of acknowledgments, as they are in the datagram."""
        self.numbers: list[int] = []
        self.payloads: list[bytes | None] = []
        self.reader = Reader(ENTITY, self.send, self.deliver, sample_bytes=sample_bytes)
        self.room_bytes = room_bytes
        self.room = Room(room_bytes)
        self.now_ns = 1000 * MS
        self.serial = 0
        self.reader.add_writer(ONE, self.room, self.now_ns, reliable=reliable)

    def send(self, guid: bytes, parts: Sequence[bytes]) -> None:
        datagram = m.read_datagram(m.write_head(bytes(12)) + b"".join(parts))
        assert not datagram.fault
        self.raw_bases.append(m.read_number64(parts[-1], 12, "<"))
        self.sent += [short(one.submessage) for one in datagram.received]

    def deliver(self, arrived: Arrived) -> None:
        self.numbers.append(arrived.number)
        self.payloads.append(arrived.payload)

    def taken(self) -> list[str]:
        found, self.sent = self.sent, []
        return found

    def data(self, *numbers: int, payload: bytes = b"x", guid: bytes = ONE) -> None:
        for number in numbers:
            one = m.Data(ENTITY, guid[12:], number, payload, {}, "<")
            self.reader.data(guid, one, 5, self.now_ns)

    def fragment(self, number: int, first: int, payload: bytes, size: int = 4) -> None:
        piece = payload[(first - 1) * size : first * size]
        one = m.DataFragments(ENTITY, ONE[12:], number, first, 1, size, len(payload), piece, {}, "<")
        self.reader.fragments(ONE, one, 5, self.now_ns)

    def heartbeat(self, first: int, last: int, *, is_final: bool = False, serial: int | None = None) -> None:
        self.serial += 1
        one = m.Heartbeat(ENTITY, ONE[12:], first, last, serial or self.serial, is_final)
        self.reader.heartbeat(ONE, one, self.now_ns)

    def gap(self, first: int, base: int, *more: int) -> None:
        self.reader.gap(ONE, m.Gap(ENTITY, ONE[12:], first, base, more), self.now_ns)

    def wait(self, ms: int) -> None:
        end = self.now_ns + ms * MS
        while (due := self.reader.due_ns) is not None and due <= end:
            self.now_ns = max(due, self.now_ns)
            self.reader.act(self.now_ns)
        self.now_ns = end

    def begin(self) -> None:
        """The writer has nothing so far."""
        self.heartbeat(1, 0)
        self.taken()
        self.wait(20)


def short(one: m.Submessage) -> str:
    match one:
        case m.AckNack():
            return f"has <{one.base}" + "".join(f" wants {number}" for number in one.missing)
        case m.NackFragments():
            return f"wants {one.number}." + ",".join(map(str, one.missing))
    raise AssertionError(one)


def test_samples_in_order() -> None:
    world = World()
    world.begin()
    world.data(1, 2)
    world.heartbeat(1, 2)
    assert world.numbers == [1, 2]
    assert world.taken() == ["has <3"]
    world.heartbeat(1, 2, is_final=True)
    assert world.taken() == []


def test_it_asks_for_a_heartbeat_until_one_comes() -> None:
    world = World()
    assert world.taken() == ["has <1"]
    assert not world.reader.is_following(ONE) and world.reader.newest(ONE) is None
    world.wait(11)
    assert world.raw_bases == [1, 0]  # the first word that the standard wants, and the one for Fast DDS
    world.wait(10_000)
    assert 10 < len(world.taken()) < 25
    world.heartbeat(1, 0)
    assert world.reader.is_following(ONE) and world.reader.newest(ONE) == 0
    world.taken()
    world.wait(10_000)
    assert world.taken() == [] and world.reader.due_ns is None


def test_a_missing_sample() -> None:
    world = World()
    world.begin()
    world.data(1, 3, 4)
    assert world.numbers == [1]
    world.heartbeat(1, 6)
    assert world.taken() == ["has <2 wants 2 wants 5 wants 6"]
    world.heartbeat(1, 6)
    assert world.taken() == []  # it has just asked
    world.wait(11)
    assert world.taken() == ["has <2 wants 2 wants 5 wants 6"]
    world.data(2, 5, 6)
    assert world.numbers == [1, 2, 3, 4, 5, 6]
    assert world.taken() == ["has <7"]
    assert world.reader.due_ns is None and world.room.left == world.room_bytes


def test_a_repetition_is_no_sample() -> None:
    world = World()
    world.begin()
    world.data(1, 1, 3, 3, 2, 2, 3)
    assert world.numbers == [1, 2, 3]


def test_history_before_the_match_is_not_lost() -> None:
    world = World()
    world.data(50)
    assert world.numbers == []
    world.heartbeat(50, 50)
    assert world.numbers == [50]
    assert world.reader.lost == 0


def test_samples_that_the_writer_no_longer_has() -> None:
    world = World()
    world.begin()
    world.data(1, 4)
    world.heartbeat(4, 5)
    assert world.numbers == [1, 4]
    assert world.reader.lost == 2
    world.heartbeat(2**62, 2**62 - 1)
    assert world.numbers == [1, 4]
    world.data(2**62)
    assert world.numbers == [1, 4, 2**62]


def test_gaps() -> None:
    world = World()
    world.begin()
    world.gap(1, 3, 4)
    world.data(3)
    assert world.numbers == [3]
    world.data(5)
    assert world.numbers == [3, 5]
    world.data(9)
    world.gap(7, 9)
    assert world.numbers == [3, 5]
    world.data(6)
    assert world.numbers == [3, 5, 6, 9]
    world.gap(10, 2**62)
    world.data(2**62)
    assert world.numbers[-1] == 2**62
    assert world.reader.lost == 0


def test_a_gap_far_ahead() -> None:
    world = World()
    world.begin()
    world.gap(3, 2**62)
    world.data(1, 2, 3)
    assert world.numbers == [1, 2]
    world.heartbeat(1, 300)
    assert world.taken()[-1].startswith("has <257 wants 257")


def test_old_and_repeated_heartbeats_are_ignored() -> None:
    world = World()
    world.heartbeat(1, 5, serial=7)
    world.taken()
    world.wait(5)
    for serial in (7, 6):
        world.heartbeat(1, 5, serial=serial)
    assert world.taken() == []


def test_missing_fragments_are_requested_again() -> None:
    world = World()
    world.begin()
    payload = b"abcdefghij"
    world.fragment(1, 3, payload)
    world.fragment(1, 1, payload)
    world.data(2)
    world.heartbeat(1, 2)
    assert world.taken() == ["has <1"]  # others may be under way
    world.wait(11)
    assert world.taken() == ["wants 1.2", "has <1"]
    world.fragment(1, 2, payload)
    assert world.payloads == [payload, b"x"]
    assert world.room.left == world.room_bytes
    world.fragment(1, 2, payload)
    assert world.room.left == world.room_bytes


def test_a_heartbeat_of_fragments() -> None:
    world = World()
    world.begin()
    world.fragment(1, 1, b"abcdefghij")
    world.taken()
    world.now_ns += 20 * MS
    world.reader.heartbeat_fragment(ONE, m.HeartbeatFragment(ENTITY, ONE[12:], 1, 3, 1), world.now_ns)
    assert world.taken() == ["wants 1.2,3", "has <1"]


def test_a_sample_that_is_too_long() -> None:
    world = World()
    world.begin()
    world.fragment(1, 1, bytes(1001))
    world.data(2)
    assert world.numbers == [2]
    assert world.reader.too_long == 1


def test_room() -> None:
    world = World(room_bytes=3 * (ITEM_BYTES + 10))
    world.begin()
    world.data(5, 4, 3, payload=bytes(10))
    world.data(2, payload=bytes(10))  # 5 gives way
    world.data(6, payload=bytes(10))  # no room
    assert world.reader.put_off == 1
    world.heartbeat(1, 6)
    assert world.taken() == ["has <1 wants 1 wants 5 wants 6"]
    world.data(1)
    assert world.numbers == [1, 2, 3, 4]
    world.data(5, 6)
    assert world.numbers == [1, 2, 3, 4, 5, 6]
    assert world.room.left == world.room_bytes


def test_samples_in_fragments_give_way_to_an_earlier_one() -> None:
    world = World()
    world.begin()
    for number in range(2, 18):
        world.fragment(number, 1, bytes(8))
    world.fragment(18, 1, bytes(8))
    assert world.reader.put_off == 1
    for first in (1, 2):
        world.fragment(1, first, bytes(8))
    assert world.numbers == [1]


def test_fragments_that_never_become_a_sample_are_given_up() -> None:
    world = World(reliable=False)
    world.fragment(3, 1, bytes(8))
    assert world.room.left < world.room_bytes
    world.wait(11_000)
    assert world.room.left == world.room_bytes
    assert world.reader.due_ns is None


def test_a_best_effort_writer() -> None:
    world = World(reliable=False)
    world.data(3, 5, 4)
    assert world.numbers == [3, 5]
    assert world.reader.lost == 1
    world.fragment(6, 1, b"abcdefgh")
    world.fragment(6, 2, b"abcdefgh")
    assert world.numbers == [3, 5, 6]
    world.fragment(7, 1, b"abcdefgh")
    world.data(8)
    assert world.room.left == world.room_bytes
    assert world.taken() == []


def test_a_writer_that_goes_leaves_nothing() -> None:
    world = World()
    world.begin()
    world.data(2)
    world.fragment(3, 1, bytes(8))
    world.reader.remove_writer(ONE)
    assert world.room.left == world.room_bytes
    world.data(1)
    world.heartbeat(1, 3)
    assert world.numbers == [] and world.reader.writers == [] and world.reader.due_ns is None


def test_writers_are_apart() -> None:
    world = World()
    world.begin()
    world.reader.add_writer(TWO, world.room, world.now_ns)
    world.data(1)
    world.data(1, 2, guid=TWO)
    assert world.numbers == [1, 1] or world.numbers == [1, 1, 2]

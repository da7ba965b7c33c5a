"""A writer: heartbeats, repairs and gaps, and how long it keeps what."""

from collections.abc import Sequence

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.ids import reader_id, writer_id
from bus_bridge.rtps.writer import USUAL, Keeping, Writer

MS = 1_000_000
ENTITY = writer_id(1)
ONE, TWO = b"1" * 12 + reader_id(1), b"2" * 12 + reader_id(1)


class World:
    """A writer, and what it has sent to each reader since the last look."""

    def __init__(self, keeping: Keeping = USUAL, fragment_bytes: int = 100) -> None:
        self.sent: list[tuple[bytes, m.Submessage]] = []
        self.writer = Writer(ENTITY, self.send, keeping, fragment_bytes=fragment_bytes)
        self.now_ns = 1000 * MS
        self.serial = 0

    def send(self, guid: bytes, parts: Sequence[bytes]) -> None:
        datagram = m.read_datagram(m.write_head(bytes(12)) + b"".join(parts))
        assert not datagram.fault
        self.sent += [(guid, one.submessage) for one in datagram.received]

    def taken(self, guid: bytes = ONE) -> list[str]:
        """What went to a reader, in short."""
        found, self.sent = [one for to, one in self.sent if to == guid], []
        return [short(one) for one in found]

    def write(self, payload: bytes = b"x", to: bytes | None = None, stays: bool = True) -> int:
        return self.writer.write(payload, self.now_ns, 5, to=to, stays=stays)

    def add(self, guid: bytes = ONE, *, reliable: bool = True) -> None:
        self.writer.add_reader(guid, self.now_ns, reliable=reliable)

    def acknowledge(
        self, base: int, *missing: int, guid: bytes = ONE, is_final: bool = True, serial: int | None = None
    ) -> None:
        self.serial += 1
        acknack = m.AckNack(guid[12:], ENTITY, base, missing, serial or self.serial, is_final)
        self.writer.acknowledge(guid, acknack, self.now_ns)

    def ask_fragments(self, number: int, *missing: int) -> None:
        self.serial += 1
        nack = m.NackFragments(ONE[12:], ENTITY, number, missing, self.serial)
        self.writer.request_fragments(ONE, nack, self.now_ns)

    def wait(self, ms: int) -> None:
        """Time passes, and the writer acts when it wants to."""
        end = self.now_ns + ms * MS
        while (due := self.writer.due_ns) is not None and due <= end:
            self.now_ns = max(due, self.now_ns)
            self.writer.act(self.now_ns)
        self.now_ns = end


def short(one: m.Submessage) -> str:
    match one:
        case m.Data():
            return f"data {one.number}"
        case m.DataFragments():
            return f"fragment {one.number}.{one.first}"
        case m.Heartbeat():
            return f"heartbeat {one.first}-{one.last}"
        case m.Gap():
            return f"gap {one.first}-{one.base - 1}" + "".join(f",{more}" for more in one.more)
    raise AssertionError(one)


def test_a_sample_and_its_acknowledgment() -> None:
    world = World()
    world.add()
    assert world.taken() == ["heartbeat 1-0"]
    world.acknowledge(1)
    assert world.writer.has_answered(ONE)
    world.taken()
    assert world.write() == 1
    assert world.taken() == ["data 1", "heartbeat 1-1"]
    assert (world.writer.kept, world.writer.acknowledged(ONE)) == (1, 0)
    world.acknowledge(2)
    assert (world.writer.kept, world.writer.kept_bytes, world.writer.acknowledged(ONE)) == (0, 0, 1)
    world.wait(10_000)
    assert world.taken() == []


def test_heartbeats_until_the_reader_answers_and_less_and_less_often() -> None:
    world = World()
    world.add()
    world.wait(60_000)
    beats = len(world.taken())
    assert 30 <= beats <= 40
    world.acknowledge(1)
    world.taken()
    world.wait(60_000)
    assert world.taken() == []
    world.write()
    world.taken()
    world.wait(1000)
    assert 4 <= len(world.taken()) <= 7


def test_a_repair() -> None:
    world = World()
    world.add()
    world.acknowledge(1)
    for _ in range(4):
        world.write()
    world.taken()
    world.acknowledge(2, 2, 4)
    assert world.taken() == ["data 2", "data 4", "heartbeat 1-4"]
    assert world.writer.repaired == 2
    world.acknowledge(2, 2)  # it was under way meanwhile
    assert world.taken() == []
    world.wait(6)
    assert world.taken() == ["data 2", "heartbeat 1-4"]
    world.acknowledge(5)
    assert world.writer.due_ns is None and world.writer.kept == 0


def test_a_storm_of_requests_costs_little() -> None:
    world = World()
    world.add()
    world.acknowledge(1)
    world.write()
    world.taken()
    for _ in range(1000):
        world.acknowledge(1, 1)
    assert world.taken() == ["data 1", "heartbeat 1-1"]


def test_old_and_repeated_requests_are_ignored() -> None:
    world = World()
    world.add()
    world.acknowledge(1)
    world.write()
    world.acknowledge(1, serial=9)
    world.taken()
    world.wait(10)
    for serial in (9, 8):
        world.acknowledge(1, 1, serial=serial)
    assert world.taken() == []


def test_a_late_joiner_that_begins_anew_gets_all_again() -> None:
    """It has removed the writer, so it counts from 1 again."""
    world = World(Keeping(for_late_joiners=True))
    world.add()
    for number in range(1, 4):
        world.write()
        world.acknowledge(number + 1, serial=10 + number)
    world.taken()
    world.acknowledge(0, is_final=False, serial=1)
    assert world.taken() == []
    world.wait(600)
    world.acknowledge(1, is_final=False, serial=2)
    assert world.taken() == ["heartbeat 1-3"]
    assert (world.writer.acknowledged(ONE), world.writer.waiting) == (0, 3)
    world.acknowledge(1, 1, 2, 3, serial=3)
    assert world.taken()[:3] == ["data 1", "data 2", "data 3"]
    world.acknowledge(4, serial=4)
    assert world.writer.acknowledged(ONE) == 3
    world.taken()
    world.acknowledge(1, is_final=False, serial=5)  # at once again: it has to wait
    assert world.writer.acknowledged(ONE) == 3
    world.wait(3_000)
    world.acknowledge(3, is_final=False, serial=6)
    assert world.writer.acknowledged(ONE) == 2


def test_serials_go_on_for_a_reader_that_is_back() -> None:
    """It may not have noticed that it was removed."""
    serials = []
    world = World()
    for _ in range(3):
        world.add()
        world.wait(3_000)
        world.writer.remove_reader(ONE)
        serials += [one.serial for _, one in world.sent if isinstance(one, m.Heartbeat)]
        world.sent.clear()
    assert len(serials) > 9 and serials == sorted(set(serials))


def test_a_volatile_writer_sends_nothing_again() -> None:
    world = World()
    world.add()
    world.write()
    world.acknowledge(2)
    world.taken()
    world.acknowledge(1, 1, is_final=False)
    assert not any("data" in one for one in world.taken())


def test_a_reader_can_be_asked_for_a_sign_of_life() -> None:
    world = World()
    world.add(ONE)
    world.add(TWO, reliable=False)
    world.acknowledge(1)
    world.taken()
    assert world.writer.ask(ONE, world.now_ns) and world.taken() == ["heartbeat 1-0"]
    assert not world.writer.ask(TWO, world.now_ns) and not world.writer.ask(b"?" * 16, world.now_ns)


def test_an_addressed_sample() -> None:
    world = World()
    for guid in (ONE, TWO):
        world.add(guid)
        world.acknowledge(1, guid=guid)
    world.taken()
    world.write(to=TWO)
    assert world.taken(TWO) == ["data 1", "heartbeat 1-1"]
    world.write(to=TWO)
    assert world.taken(ONE) == []
    world.write()
    assert world.taken(ONE) == ["gap 1-2", "data 3", "heartbeat 1-3"]
    world.acknowledge(1, 1, 2, 3)
    assert world.taken(ONE) == ["gap 1-2", "data 3", "heartbeat 1-3"]
    world.acknowledge(4)
    world.acknowledge(4, guid=TWO)
    assert world.writer.kept == 0


def test_a_late_reader_of_a_volatile_writer() -> None:
    world = World()
    world.write()
    assert world.writer.kept == 0
    world.add()
    assert world.taken() == ["heartbeat 2-1"]
    world.write()
    assert world.taken() == ["gap 1-1", "data 2", "heartbeat 2-2"]


def test_a_late_reader_of_kept_samples() -> None:
    world = World(Keeping(for_late_joiners=True))
    for _ in range(3):
        world.write()
    world.writer.withdraw(2)
    world.write(stays=False)
    assert world.writer.kept == 2
    world.add()
    assert world.taken() == ["data 1", "heartbeat 1-4", "gap 2-2", "data 3", "heartbeat 1-4", "heartbeat 1-4"]
    world.acknowledge(4, 4)
    assert world.taken() == ["gap 4-4"]
    world.acknowledge(5)
    assert world.writer.kept == 2 and world.writer.due_ns is None


def test_what_is_kept_has_a_limit() -> None:
    world = World(Keeping(changes=2))
    world.add()
    world.acknowledge(1)
    for _ in range(4):
        world.write()
    assert (world.writer.kept, world.writer.lost) == (2, 2)
    world.taken()
    world.acknowledge(1, 1, 2, 3, 4)
    assert world.taken() == ["data 3", "data 4", "heartbeat 3-4", "heartbeat 3-4"]


def test_the_limit_of_bytes() -> None:
    world = World(Keeping(payload_bytes=50))
    world.add()
    world.write(bytes(40))
    world.write(bytes(20))
    assert (world.writer.kept, world.writer.kept_bytes, world.writer.lost) == (1, 20, 1)
    world.write(bytes(60))
    assert (world.writer.kept, world.writer.kept_bytes, world.writer.lost) == (0, 0, 3)


def test_acknowledged_samples_for_late_joiners_give_way_and_do_not_wait() -> None:
    world = World(Keeping(changes=3, for_late_joiners=True))
    world.add()
    world.acknowledge(1)
    for number in range(1, 6):
        world.write(bytes(10))
        assert (world.writer.waiting, world.writer.waiting_bytes) == (1, 10)
        world.acknowledge(number + 1)
        assert (world.writer.waiting, world.writer.waiting_bytes) == (0, 0)
    assert (world.writer.kept, world.writer.lost) == (3, 0)
    world.add(TWO)  # it gets the kept ones
    assert (world.writer.waiting, world.writer.waiting_bytes) == (3, 30)
    world.acknowledge(5, guid=TWO)
    assert world.writer.waiting == 1
    world.write(bytes(10))
    world.acknowledge(7)
    assert world.writer.waiting == 2
    world.writer.remove_reader(TWO)
    assert (world.writer.waiting, world.writer.waiting_bytes, world.writer.lost) == (0, 0, 0)


def test_samples_that_are_dropped_do_not_wait() -> None:
    world = World(Keeping(changes=2))
    world.add()
    for _ in range(4):
        world.write(bytes(10))
    assert (world.writer.waiting, world.writer.waiting_bytes, world.writer.lost) == (2, 20, 2)
    world.writer.withdraw(4)
    assert (world.writer.waiting, world.writer.waiting_bytes) == (1, 10)
    world.acknowledge(5)
    assert (world.writer.waiting, world.writer.waiting_bytes) == (0, 0)


def test_a_reader_that_goes_holds_nothing() -> None:
    world = World()
    world.add()
    world.add(TWO)
    world.write()
    world.acknowledge(2)
    assert world.writer.kept == 1
    world.writer.remove_reader(TWO)
    assert world.writer.kept == 0 and world.writer.readers == [ONE]
    world.acknowledge(1, 1, guid=TWO)
    world.writer.remove_reader(TWO)


def test_fragments() -> None:
    world = World()
    world.add()
    world.acknowledge(1)
    world.taken()
    world.write(bytes(250))
    assert world.taken() == ["fragment 1.1", "fragment 1.2", "fragment 1.3", "heartbeat 1-1"]
    world.ask_fragments(1, 2, 9)
    assert world.taken() == ["fragment 1.2", "heartbeat 1-1"]
    world.ask_fragments(7, 1)
    assert world.taken() == []


def test_repairs_are_sent_in_pieces() -> None:
    world = World(fragment_bytes=60_000)
    world.add()
    world.acknowledge(1)
    for _ in range(4):
        world.write(bytes(120_000))
    world.taken()
    world.acknowledge(1, 1, 2, 3, 4)
    assert len([one for one in world.taken() if one.startswith("fragment")]) == 6
    world.wait(6)
    assert [one for one in world.taken() if one.startswith("fragment")] == ["fragment 4.1", "fragment 4.2"]


def test_a_best_effort_reader_gets_each_once() -> None:
    world = World()
    world.add(reliable=False)
    world.write()
    world.acknowledge(1, 1)
    assert world.taken() == ["gap 1-0", "data 1"][1:]
    assert world.writer.kept == 0 and world.writer.due_ns is None


def test_an_acknowledgment_of_the_future() -> None:
    world = World()
    world.add()
    world.acknowledge(2**62)
    world.write()
    assert world.writer.acknowledged(ONE) == 0
    assert world.writer.kept == 1

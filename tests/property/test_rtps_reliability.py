"""A writer and two readers on a network that loses, repeats and reorders: each reader gets what is for it, in
order and once, and at the end both ends are at rest."""

from collections.abc import Sequence
from typing import NamedTuple

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bus_bridge.rtps import messages as m
from bus_bridge.rtps.ids import reader_id, writer_id
from bus_bridge.rtps.reader import Arrived, Reader
from bus_bridge.rtps.room import ITEM_BYTES, Room
from bus_bridge.rtps.writer import Keeping, Writer
from effort import examples

MS = 1_000_000
WRITER = b"w" * 12 + writer_id(1)
READERS = (b"1" * 12 + reader_id(1), b"2" * 12 + reader_id(1))
ROOM_BYTES = 20 * ITEM_BYTES


class Fate(NamedTuple):
    """What happens to a datagram."""

    copies: int
    delay_ms: int


FATES = st.lists(
    st.builds(Fate, st.sampled_from([0, 0, 1, 1, 1, 1, 2]), st.sampled_from([1, 1, 1, 3, 20])), max_size=120
)


class Network:
    """Datagrams under way, with a fate each; after the given fates nothing is lost any more."""

    def __init__(self, fates: Sequence[Fate]) -> None:
        self.fates = list(fates)
        self.now_ns = 0
        self.under_way: list[tuple[int, int, bytes, bytes, bytes]] = []
        self.sent = 0
        self.got: dict[bytes, list[tuple[int, bytes | None]]] = {guid: [] for guid in READERS}
        self.rooms = {guid: Room(ROOM_BYTES) for guid in READERS}
        self.readers = {
            guid: Reader(
                guid[12:],
                lambda to, parts, guid=guid: self.send(guid, to, parts),
                lambda one, guid=guid: self.deliver(guid, one),
            )
            for guid in READERS
        }

    def send(self, source: bytes, to: bytes, parts: Sequence[bytes]) -> None:
        self.sent += 1
        fate = self.fates.pop(0) if self.fates else Fate(1, 1)
        for copy in range(fate.copies):
            at_ns = self.now_ns + (fate.delay_ms + 7 * copy) * MS
            self.under_way.append((at_ns, self.sent, source, to, b"".join(parts)))

    def deliver(self, guid: bytes, one: Arrived) -> None:
        self.got[guid].append((one.number, one.payload))

    def run(self, writer: Writer, until_ns: int) -> None:
        """Let time pass, until nothing is to be done any more or `until_ns`."""
        while True:
            due = [writer.due_ns, *(reader.due_ns for reader in self.readers.values())]
            times = [one for one in due if one is not None] + [one[0] for one in self.under_way]
            if not times or min(times) > until_ns:
                return
            self.now_ns = max(self.now_ns, min(times))
            arrived = sorted(one for one in self.under_way if one[0] <= self.now_ns)
            self.under_way = [one for one in self.under_way if one[0] > self.now_ns]
            for _, _, source, to, data in arrived:
                self.arrive(writer, source, to, data)
            if writer.due_ns is not None and writer.due_ns <= self.now_ns:
                writer.act(self.now_ns)
            for reader in self.readers.values():
                if reader.due_ns is not None and reader.due_ns <= self.now_ns:
                    reader.act(self.now_ns)

    def arrive(self, writer: Writer, source: bytes, to: bytes, data: bytes) -> None:
        datagram = m.read_datagram(m.write_head(source[:12]) + data)
        assert not datagram.fault
        for received in datagram.received:
            match received.submessage:
                case m.AckNack() as one:
                    writer.acknowledge(source, one, self.now_ns)
                case m.NackFragments() as one:
                    writer.request_fragments(source, one, self.now_ns)
                case m.Data() as one:
                    self.readers[to].data(WRITER, one, received.time_ns, self.now_ns)
                case m.DataFragments() as one:
                    self.readers[to].fragments(WRITER, one, received.time_ns, self.now_ns)
                case m.Heartbeat() as one:
                    self.readers[to].heartbeat(WRITER, one, self.now_ns)
                case m.Gap() as one:
                    self.readers[to].gap(WRITER, one, self.now_ns)


STEPS = st.lists(
    st.tuples(
        st.sampled_from([None, *READERS]),
        st.one_of(st.binary(max_size=8), st.binary(min_size=20, max_size=60)),
        st.sampled_from([0, 0, 1, 30]),
    ),
    max_size=25,
)


@settings(max_examples=examples(150), deadline=None, suppress_health_check=list(HealthCheck))
@given(STEPS, FATES, st.booleans())
def test_each_gets_all_of_its_own_once(
    steps: list[tuple[bytes | None, bytes, int]], fates: list[Fate], is_late: bool
) -> None:
    network = Network(fates)
    keeping = Keeping(for_late_joiners=is_late)
    writer = Writer(
        WRITER[12:], lambda to, parts: network.send(WRITER, to, parts), keeping, fragment_bytes=16
    )

    def match() -> None:
        for guid, reader in network.readers.items():
            writer.add_reader(guid, network.now_ns)
            reader.add_writer(WRITER, network.rooms[guid], network.now_ns)

    if not is_late:
        match()
    wanted: dict[bytes, list[tuple[int, bytes | None]]] = {guid: [] for guid in READERS}
    for to, payload, pause_ms in steps:
        number = writer.write(payload, network.now_ns, 1, to=None if is_late else to)
        for guid in READERS:
            if is_late or to in (None, guid):
                wanted[guid].append((number, payload))
        network.run(writer, network.now_ns + pause_ms * MS)
    if is_late:
        match()
    network.run(writer, network.now_ns + 120_000 * MS)
    assert network.got == wanted
    assert writer.due_ns is None
    assert all(reader.due_ns is None and not reader.lost for reader in network.readers.values())
    assert all(room.left == ROOM_BYTES for room in network.rooms.values())
    assert writer.kept == (len(steps) if is_late else 0)

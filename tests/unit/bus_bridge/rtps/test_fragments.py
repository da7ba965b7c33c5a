"""A sample in fragments: in any order, and never more memory than what has come."""

from bus_bridge.rtps.fragments import Partial
from bus_bridge.rtps.messages import DataFragments
from bus_bridge.rtps.room import ITEM_BYTES, Room

PAYLOAD = bytes(range(10))


def piece(first: int, amount: int = 1, size: int = 4, total: int = 10) -> DataFragments:
    payload = PAYLOAD[(first - 1) * size : (first - 1 + amount) * size]
    return DataFragments(b"rrr4", b"www3", 1, first, amount, size, total, payload, {}, "<")


def test_in_any_order() -> None:
    room = Room(10_000)
    partial = Partial(piece(3), 7, room)
    for one in (piece(3), piece(1), piece(1)):
        assert partial.add(one, 5)
    assert (partial.missing(), partial.is_whole, partial.time_ns, partial.touched_ns) == ([2], False, 7, 5)
    assert partial.add(piece(1, 2), 6)
    assert partial.is_whole and partial.missing() == []
    assert partial.join() == PAYLOAD
    assert room.left == 10_000


def test_a_false_total_takes_no_memory() -> None:
    room = Room(10_000)
    partial = Partial(piece(1, total=2**32 - 1), 0, room)
    assert partial.add(piece(1, total=2**32 - 1), 0)
    assert room.left == 10_000 - 4 - ITEM_BYTES
    assert partial.missing() == list(range(2, 257 + 1))[: len(partial.missing())]
    assert len(partial.missing()) <= 256
    partial.discard()
    assert room.left == 10_000


def test_fragments_of_another_sample_are_ignored() -> None:
    partial = Partial(piece(1), 0, Room(10_000))
    assert partial.add(piece(1), 0)
    assert partial.add(piece(2, size=3), 0)
    assert partial.missing() == [2, 3]


def test_no_room() -> None:
    room = Room(ITEM_BYTES + 5)
    partial = Partial(piece(1), 0, room)
    assert partial.add(piece(1), 0)
    assert not partial.add(piece(2), 0)
    assert partial.missing() == [2, 3]

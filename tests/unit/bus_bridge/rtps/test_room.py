"""Room for samples: each has a cost, also an empty one."""

from bus_bridge.rtps.room import ITEM_BYTES, Room


def test_room() -> None:
    room = Room(2 * ITEM_BYTES + 10)
    assert room.take(10)
    assert not room.take(1)
    assert room.take(0)
    assert room.left == 0
    room.give_back(10, 2)
    assert room.left == 2 * ITEM_BYTES + 10

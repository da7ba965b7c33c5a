"""Space reserved for the end of a file."""

from pathlib import Path

from bus_bag.storage.reserve import Reserve


def test_the_reserve_leaves_nothing_behind(tmp_path: Path) -> None:
    reserve = Reserve(tmp_path)
    reserve.hold(3 << 20)
    assert list(tmp_path.iterdir()) == []
    assert reserve.give_back()
    assert not reserve.give_back()

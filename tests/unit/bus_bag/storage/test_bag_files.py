"""The files of a bag in order, and the counts if the oldest files are deleted."""

from pathlib import Path

from bags import CHATTER
from bus_bag.storage.bag_files import BagFiles
from bus_bag.storage.registry import DEFAULT


def write(files: BagFiles, count: int) -> None:
    """Write `count` messages into the present file."""
    gathered = DEFAULT.gather()
    for number in range(count):
        gathered.add(0, number, number, number, [b"data"])
    files.present.write_schema(1, CHATTER.type, "string data\n")
    files.present.write_channel(0, 1, CHATTER, {})
    files.present.write_chunk(gathered.close())


def test_of_more_files_than_there_may_be_the_oldest_is_deleted(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    files = BagFiles(folder, DEFAULT, "none", most_files=2)
    sizes = []
    for count in (1, 2, 4):
        write(files, count)
        files.close()
        sizes.append(files.size)
        files.open_next()
    assert sorted(path.name for path in folder.iterdir()) == ["walk_2.mcap", "walk_3.mcap"]
    assert sizes == sorted(sizes)
    assert (files.counts(), +files.counts_there()) == ({0: 7}, {0: 4})
    assert [(one.path, one.message_count) for one in files.information()] == [
        ("walk_2.mcap", 4),
        ("walk_3.mcap", 0),
    ]
    files.close()
    assert files.counts() == {0: 7} and not files.present.is_open

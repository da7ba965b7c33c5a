"""Repair of bags."""

from pathlib import Path

import pytest

pytest.importorskip("mcap")
pytest.importorskip("rosbags")

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from bags import begin_bag, read, said, text_of, write, write_bag
from bus_bag.errors import BagError
from bus_bag.metadata import from_record
from bus_bag.reindex import reindex
from bus_bag.storage import open_bag


def test_metadata_is_made_anew(tmp_path: Path) -> None:
    messages = said(100)
    folder = write_bag(tmp_path / "walk", messages[:50], messages[50:], custom_data={"robot": "7"})
    before = (folder / "metadata.yaml").read_text()
    contents = {path.name: path.read_bytes() for path in folder.glob("*.mcap")}
    (folder / "metadata.yaml").unlink()
    lines: list[str] = []
    assert reindex(folder, lines.append) == []
    assert (folder / "metadata.yaml").read_text() == before
    assert {path.name: path.read_bytes() for path in folder.glob("*.mcap")} == contents
    assert lines == ["metadata.yaml: 100 messages in 2 files"]


@pytest.mark.parametrize("preset", ["none", "fastwrite", "zstd_fast"])
def test_a_file_that_was_cut(tmp_path: Path, preset: str) -> None:
    messages = said(3000, length=500)
    folder = write_bag(tmp_path / "walk", messages[:2000], messages[2000:], preset=preset)
    (folder / "metadata.yaml").unlink()
    path = folder / "walk_1.mcap"
    path.write_bytes(path.read_bytes()[:-2000])
    with open_bag(folder) as reader:
        assert reader.is_cut
        readable = read(reader)
        assert len(readable) >= 2000
    lines: list[str] = []
    problems = reindex(folder, lines.append)
    assert any("the file was not closed" in problem.text for problem in problems)
    assert lines[-1] == f"metadata.yaml: {len(readable)} messages in 2 files"
    assert sorted(one.name for one in folder.iterdir()) == ["metadata.yaml", "walk_0.mcap", "walk_1.mcap"]
    with open_bag(folder) as reader:
        assert (read(reader), reader.problems, reader.is_cut) == (readable, [], False)
    with AnyReader([folder]) as others:
        assert [text_of(raw) for _, _, raw in others.messages()] == [one.text for one in readable]
    with path.open("rb") as stream:
        judge = make_reader(stream, validate_crcs=True)
        summary = judge.get_summary()
        assert summary is not None and summary.chunk_indexes[0].message_index_length > 0
        texts = [
            one.metadata["serialized_metadata"] for one in judge.iter_metadata() if one.name == "rosbag2"
        ]
    assert from_record(texts[-1]).message_count == len(readable)
    assert reindex(folder, lines.append) == []


def test_records_stay(tmp_path: Path) -> None:
    writer, channels = begin_bag(tmp_path / "walk")
    write(writer, channels, said(10))
    writer.write_metadata("busd.losses", {"/chatter": "{}"})
    writer.close()
    path = tmp_path / "walk" / "walk_0.mcap"
    path.write_bytes(path.read_bytes()[:-1])
    reindex(tmp_path / "walk", lambda line: None)
    with open_bag(path) as reader:
        assert ("busd.losses", {"/chatter": "{}"}) in reader.files[0].records
        assert reader.extra["/chatter"] == {"busd.type_hash": "BUS01_1"}


def test_a_bag_that_is_being_recorded(tmp_path: Path) -> None:
    """The bag can be read up to now. Reindexing does not touch it: later messages would be lost with the old
    file.
    """
    writer, channels = begin_bag(tmp_path / "walk")
    write(writer, channels, said(10))
    writer.flush()
    write(writer, channels, said(10, first=10))
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == said(10)
        assert (reader.is_cut, reader.is_being_written) == (True, True)
        assert reader.problems[-1].text == "the file is still being written"
    with pytest.raises(BagError, match=r"walk_0.mcap' is still being written$"):
        reindex(tmp_path / "walk", print)
    writer.close()
    with open_bag(tmp_path / "walk") as reader:
        assert read(reader) == said(20)
        assert (reader.is_cut, reader.is_being_written) == (False, False)


def test_no_bag(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "walk", said(10))
    with pytest.raises(BagError, match=r"^Must specify a bag directory$"):
        reindex(folder / "walk_0.mcap", print)
    with pytest.raises(BagError, match=r"^Bag path '.*/nowhere' does not exist!$"):
        reindex(tmp_path / "nowhere", print)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match="is not a bag"):
        reindex(tmp_path / "empty", print)


def test_no_room_for_the_new_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The old file stays as it was."""
    folder = write_bag(tmp_path / "walk", said(10))
    path = folder / "walk_0.mcap"
    path.write_bytes(path.read_bytes()[:-1])
    before = path.read_bytes()
    monkeypatch.setattr("os.writev", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(BagError, match=r"can't grow beyond 0 bytes: No space left on device$"):
        reindex(folder, print)
    assert path.read_bytes() == before
    assert len(list(folder.iterdir())) == 2
